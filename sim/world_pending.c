/* sim/world_pending.c: TEMPORARY stand-in until sim/world.c and sim/faults.c are merged. Drop this file. */
#include "sim/faults.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

struct sim_world {
	struct bb_clock *clk;
	const struct bb_room *room;
	int64_t scene_ns;
	size_t n_unfed, n_dev;
	char unfed[64][80];
	struct {
		char class_name[16], id[BB_ID_MAX];
		void *device;
		const struct sim_verb *verbs;
	} dev[64];
};

enum bb_status sim_world_create(const struct bb_room *room, const struct bb_path *head, const struct bb_path *wand,
                                struct bb_clock *clk, struct bb_eventlog *events, uint64_t seed,
                                struct sim_world **out)
{
	(void)head, (void)wand, (void)events, (void)seed;
	*out = calloc(1, sizeof(**out));
	if (!*out)
		return BB_ERR_NOMEM;
	(*out)->clk = clk;
	(*out)->room = room;
	return BB_OK;
}
void sim_world_destroy(struct sim_world *w)
{
	free(w);
}
void sim_world_set_scene_start(struct sim_world *w, int64_t at_ns)
{
	w->scene_ns = at_ns;
}
int64_t sim_world_scene_start(const struct sim_world *w)
{
	return w->scene_ns;
}
void sim_world_set_fed(struct sim_world *w, const char *outlet, bool fed)
{
	for (size_t i = 0; i < w->n_unfed; i++)
		if (!strcmp(w->unfed[i], outlet)) {
			if (fed)
				memmove(w->unfed[i], w->unfed[--w->n_unfed], 80);
			return;
		}
	if (!fed && w->n_unfed < 64)
		strncpy(w->unfed[w->n_unfed++], outlet, 79);
}
bool sim_world_fed(const struct sim_world *w, const char *outlet)
{
	for (size_t i = 0; i < w->n_unfed; i++)
		if (!strcmp(w->unfed[i], outlet))
			return false;
	return true;
}
enum bb_status sim_world_register(struct sim_world *w, const char *class_name, const char *id, void *device,
                                  const struct sim_verb *verbs)
{
	strncpy(w->dev[w->n_dev].class_name, class_name, 15);
	strncpy(w->dev[w->n_dev].id, id, BB_ID_MAX - 1);
	w->dev[w->n_dev].device = device;
	w->dev[w->n_dev++].verbs = verbs;
	return BB_OK;
}
void sim_world_unregister(struct sim_world *w, void *device)
{
	for (size_t i = 0; i < w->n_dev; i++)
		if (w->dev[i].device == device)
			w->dev[i] = w->dev[--w->n_dev];
}
void *sim_world_find(const struct sim_world *w, const char *class_name, const char *id, const struct sim_verb **verbs)
{
	for (size_t i = 0; i < w->n_dev; i++)
		if (!strcmp(w->dev[i].class_name, class_name) && !strcmp(w->dev[i].id, id)) {
			*verbs = w->dev[i].verbs;
			return w->dev[i].device;
		}
	return NULL;
}

static uint64_t mix(uint64_t *x)
{
	uint64_t z = (*x += 0x9E3779B97F4A7C15u);

	z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
	z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
	return z ^ (z >> 31);
}
void sim_rng_seed(struct sim_rng *r, uint64_t seed, const char *class_name, const char *id)
{
	uint64_t h = seed ^ 0xCBF29CE484222325u;

	for (const char *c = class_name; *c; c++)
		h = (h ^ (uint8_t)*c) * 0x100000001B3u;
	for (const char *c = id; *c; c++)
		h = (h ^ (uint8_t)*c) * 0x100000001B3u;
	memset(r, 0, sizeof(*r));
	r->s[0] = h;
}
uint64_t sim_rng_u64(struct sim_rng *r)
{
	return mix(&r->s[0]);
}
double sim_rng_uniform(struct sim_rng *r)
{
	return (double)(sim_rng_u64(r) >> 11) * 0x1p-53;
}
double sim_rng_normal(struct sim_rng *r)
{
	return sqrt(-2 * log(1 - sim_rng_uniform(r))) * cos(6.283185307179586 * sim_rng_uniform(r));
}

const char *sim_fault_arg(const struct sim_fault_args *args, const char *key)
{
	for (size_t i = 0; i < args->n; i++)
		if (!strcmp(args->arg[i].key, key))
			return args->arg[i].value;
	return NULL;
}
bool sim_fault_number(const struct sim_fault_args *args, const char *key, double fallback, double *out)
{
	const char *text = sim_fault_arg(args, key);
	char *end;

	*out = fallback;
	if (!text)
		return true;
	*out = strtod(text, &end);
	return end != text && !*end && isfinite(*out);
}
