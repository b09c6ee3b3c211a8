/* sim/world.c: creation, the register of open sims, scene start, mains. See sim/world.h. */
#include "sim/world_impl.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define REGISTERED_MAX 8192
#define UNFED_MAX 4096

bool sim_grow(void **array, size_t element_bytes, size_t n, size_t *cap, size_t most)
{
	if (n < *cap)
		return true;
	const size_t wanted = *cap ? 2 * *cap : 16;
	if (n >= most)
		return false;
	void *larger = realloc(*array, wanted * element_bytes); /* most * element_bytes is small by construction */
	if (!larger)
		return false;
	*array = larger;
	*cap = wanted;
	return true;
}

static enum bb_status register_own(struct sim_world *w)
{
	enum bb_status status = sim_world_register(w, "world", "viewer", &w->viewer, sim_viewer_verbs);

	for (size_t i = 0; i < w->room->n_nodes && status == BB_OK; i++) {
		w->nodes[i].world = w;
		status = sim_world_register(w, "node", w->room->nodes[i].id, &w->nodes[i], sim_node_verbs);
	}
	return status;
}

enum bb_status sim_world_create(const struct bb_room *room, const struct bb_path *head, const struct bb_path *wand,
                                struct bb_clock *clk, struct bb_eventlog *events, uint64_t seed,
                                struct sim_world **out)
{
	struct sim_world *w = calloc(1, sizeof(*w));
	enum bb_status status = BB_ERR_NOMEM;

	*out = NULL;
	if (!w)
		return BB_ERR_NOMEM;
	w->room = room;
	w->head_path = head;
	w->wand_path = wand;
	w->clk = clk;
	w->events = events;
	w->seed = seed;
	w->fault_source = bb_eventlog_source(events, "world", "faults");
	sim_body_init(w);
	w->nodes = calloc(room->n_nodes ? room->n_nodes : 1, sizeof(*w->nodes));
	if (w->nodes)
		status = sim_reference_init(w);
	if (status == BB_OK)
		status = register_own(w);
	if (status != BB_OK) {
		sim_world_destroy(w);
		return status;
	}
	*out = w;
	return BB_OK;
}

void sim_world_destroy(struct sim_world *w)
{
	if (!w)
		return;
	sim_faults_forget(w);
	free(w->nodes);
	free(w->piece);
	free(w->registered);
	free(w->unfed);
	free(w);
}

struct bb_clock *sim_world_clock(struct sim_world *w)
{
	return w->clk;
}

const struct bb_room *sim_world_room(const struct sim_world *w)
{
	return w->room;
}

void sim_world_set_scene_start(struct sim_world *w, int64_t at_ns)
{
	w->scene_start_ns = at_ns;
	w->memo.valid = false;
}

int64_t sim_world_scene_start(const struct sim_world *w)
{
	return w->scene_start_ns;
}

enum bb_status sim_world_register(struct sim_world *w, const char *class_name, const char *id, void *device,
                                  const struct sim_verb *verbs)
{
	if (sim_world_find(w, class_name, id, NULL))
		return BB_ERR_BUSY;
	if (!sim_grow((void **)&w->registered, sizeof(*w->registered), w->n_registered, &w->cap_registered,
	              REGISTERED_MAX))
		return BB_ERR_NOMEM;
	struct sim_registered *r = &w->registered[w->n_registered++];
	snprintf(r->class_name, sizeof(r->class_name), "%s", class_name);
	snprintf(r->id, sizeof(r->id), "%s", id);
	r->device = device;
	r->verbs = verbs;
	return BB_OK;
}

void sim_world_unregister(struct sim_world *w, void *device)
{
	for (size_t i = 0; i < w->n_registered; i++)
		if (w->registered[i].device == device) {
			w->registered[i] = w->registered[--w->n_registered];
			return;
		}
}

void *sim_world_find(const struct sim_world *w, const char *class_name, const char *id, const struct sim_verb **verbs)
{
	for (size_t i = 0; i < w->n_registered; i++) {
		const struct sim_registered *r = &w->registered[i];
		if (strcmp(r->id, id) || strcmp(r->class_name, class_name))
			continue;
		if (verbs)
			*verbs = r->verbs;
		return r->device;
	}
	return NULL;
}

static size_t unfed_index(const struct sim_world *w, const char *outlet)
{
	size_t i = 0;

	while (i < w->n_unfed && strcmp(w->unfed[i].outlet, outlet))
		i++;
	return i;
}

bool sim_world_fed(const struct sim_world *w, const char *outlet)
{
	return unfed_index(w, outlet) == w->n_unfed;
}

void sim_world_set_fed(struct sim_world *w, const char *outlet, bool fed)
{
	const size_t i = unfed_index(w, outlet);

	if (fed && i < w->n_unfed)
		w->unfed[i] = w->unfed[--w->n_unfed];
	if (fed || i < w->n_unfed)
		return;
	if (!sim_grow((void **)&w->unfed, sizeof(*w->unfed), w->n_unfed, &w->cap_unfed, UNFED_MAX))
		return; /* out of memory: the outlet stays on, the power sim's own read-back still says off */
	snprintf(w->unfed[w->n_unfed++].outlet, sizeof(w->unfed[0].outlet), "%s", outlet);
}
