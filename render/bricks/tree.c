#include "render/bricks/tree.h"

static uint32_t halved(uint32_t n)
{
	return (n + 1) / 2;
}

bool bb_tree_init(struct bb_tree *t, const uint32_t dim[3], uint32_t n_steps, uint32_t edge)
{
	uint64_t nodes = 0;

	*t = (struct bb_tree){ .n_steps = n_steps, .edge = edge, .n_levels = 1 };
	if (edge < 4 || edge > 64 || edge % 2 || !n_steps || n_steps > BB_TREE_STEPS_MAX)
		return false;
	for (int a = 0; a < 3; a++) {
		if (!dim[a] || dim[a] > BB_TREE_DIM_MAX)
			return false;
		t->dim[a] = dim[a];
	}
	for (uint32_t v[3] = { dim[0], dim[1], dim[2] }; v[0] > edge || v[1] > edge || v[2] > edge; t->n_levels++)
		for (int a = 0; a < 3; a++)
			v[a] = halved(v[a]);
	for (uint32_t l = t->n_levels; l-- > 0;)
		for (int a = 0; a < 3; a++) {
			t->voxels[l][a] = l + 1 == t->n_levels ? dim[a] : halved(t->voxels[l + 1][a]);
			t->grid[l][a] = (t->voxels[l][a] + edge - 1) / edge;
		}
	for (uint32_t l = 0; l < t->n_levels; l++) {
		t->first[l] = (uint32_t)nodes;
		nodes += (uint64_t)t->grid[l][0] * t->grid[l][1] * t->grid[l][2];
		if (nodes > BB_TREE_BRICKS_MAX)
			return false;
	}
	t->first[t->n_levels] = t->n_nodes = (uint32_t)nodes;
	t->n_times = 2 * n_steps - 1;
	t->n_bricks = nodes * t->n_times;
	return t->n_bricks <= BB_TREE_BRICKS_MAX;
}

struct bb_tree_place bb_tree_place(const struct bb_tree *t, uint32_t node)
{
	struct bb_tree_place p = { 0 };

	while (node >= t->first[p.level + 1])
		p.level++;
	const uint32_t in_level = node - t->first[p.level], *grid = t->grid[p.level];
	p.at[0] = in_level % grid[0];
	p.at[1] = in_level / grid[0] % grid[1];
	p.at[2] = in_level / grid[0] / grid[1];
	return p;
}

uint32_t bb_tree_node(const struct bb_tree *t, const struct bb_tree_place *p)
{
	const uint32_t *grid = t->grid[p->level];

	return t->first[p->level] + (p->at[2] * grid[1] + p->at[1]) * grid[0] + p->at[0];
}

uint32_t bb_tree_children(const struct bb_tree *t, uint32_t node, uint32_t child[8])
{
	const struct bb_tree_place p = bb_tree_place(t, node);
	uint32_t n = 0;

	if (p.level + 1 == t->n_levels)
		return 0;
	for (uint32_t i = 0; i < 8; i++) {
		const struct bb_tree_place c = {
			p.level + 1, { 2 * p.at[0] + (i & 1), 2 * p.at[1] + (i >> 1 & 1), 2 * p.at[2] + (i >> 2) }
		};
		const uint32_t *grid = t->grid[c.level];
		if (c.at[0] < grid[0] && c.at[1] < grid[1] && c.at[2] < grid[2])
			child[n++] = bb_tree_node(t, &c);
	}
	return n;
}

uint32_t bb_tree_parent(const struct bb_tree *t, uint32_t node)
{
	struct bb_tree_place p = bb_tree_place(t, node);

	if (!p.level)
		return BB_TREE_NONE;
	p.level--;
	for (int a = 0; a < 3; a++)
		p.at[a] /= 2;
	return bb_tree_node(t, &p);
}

static uint32_t middle(const struct bb_tree_span *s)
{
	return (s->from + s->to + 1) / 2;
}

/* Down to the child that holds what is looked for. */
static void descend(struct bb_tree_span *s, uint32_t *time, bool second)
{
	const uint32_t mid = middle(s);

	s->parent = *time;
	*time = second ? *time + 2 * (mid - s->from) : *time + 1;
	if (second)
		s->from = mid;
	else
		s->to = mid;
}

struct bb_tree_span bb_tree_span(const struct bb_tree *t, uint32_t time)
{
	struct bb_tree_span s = { .to = t->n_steps, .parent = BB_TREE_NONE };
	uint32_t at = 0;

	while (at != time)
		descend(&s, &at, time >= at + 2 * (middle(&s) - s.from));
	const bool leaf = s.to - s.from == 1;
	s.child[0] = leaf ? BB_TREE_NONE : time + 1;
	s.child[1] = leaf ? BB_TREE_NONE : time + 2 * (middle(&s) - s.from);
	return s;
}

uint32_t bb_tree_leaf_time(const struct bb_tree *t, uint32_t step)
{
	struct bb_tree_span s = { .to = t->n_steps };
	uint32_t at = 0;

	while (s.to - s.from > 1)
		descend(&s, &at, step >= middle(&s));
	return at;
}

uint64_t bb_tree_covered(const struct bb_tree *t, uint32_t node)
{
	const struct bb_tree_place p = bb_tree_place(t, node);
	const uint64_t reach = (uint64_t)t->edge << (t->n_levels - 1 - p.level);
	uint64_t n = 1;

	for (int a = 0; a < 3; a++) {
		const uint64_t from = p.at[a] * reach, left = t->dim[a] - from;
		n *= left < reach ? left : reach;
	}
	return n;
}
