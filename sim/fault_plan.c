/*
 * sim/fault_plan.c: a run's faults against the open devices: checked once, set and cleared by timers of the world's
 * rank, so a fault of an instant is there before any device acts at that instant. Each set and clear is an event.
 */
#include "sim/world_impl.h"

#include <stdlib.h>
#include <string.h>

static bool among(const char *name, const char *first, size_t n, size_t stride)
{
	for (size_t i = 0; i < n; i++)
		if (!strcmp(name, first + i * stride))
			return true;
	return false;
}

#define AMONG(name, array, n) ((n) && among((name), (array)[0].id, (n), sizeof(*(array))))

/* Is there such a device in the room at all, whether the scene models it or not? */
static bool in_room(const struct bb_room *r, const char *class_name, const char *id)
{
	if (!strcmp(class_name, "shutter"))
		return r->has_chain && !strcmp(id, r->chain.id);
	if (!strcmp(class_name, "camera"))
		return AMONG(id, r->cameras, r->n_cameras);
	if (!strcmp(class_name, "display"))
		return AMONG(id, r->screens, r->n_screens);
	if (!strcmp(class_name, "monitor"))
		return AMONG(id, r->monitors, r->n_monitors);
	if (!strcmp(class_name, "power"))
		return AMONG(id, r->pdus, r->n_pdus);
	if (!strcmp(class_name, "gamepad"))
		return AMONG(id, r->gamepads, r->n_gamepads);
	return !strcmp(class_name, "link") && !strcmp(id, r->link.id);
}

static const struct sim_verb *verb_of(const struct sim_verb *verbs, const char *name)
{
	for (const struct sim_verb *v = verbs; v->name; v++)
		if (!strcmp(v->name, name))
			return v;
	return NULL;
}

static enum bb_status check_names(const struct bb_room *r, const struct sim_fault *f, struct bb_error *err)
{
	const char *stage = sim_fault_arg(&f->args, "stage"), *node = sim_fault_arg(&f->args, "node");

	if (stage && strcmp(stage, "emitter") &&
	    !among(stage, r->chain.stage[0], r->has_chain ? (size_t)r->chain.n_stages : 0, sizeof(r->chain.stage[0])))
		return bb_fail(err, BB_ERR_CONFIG, 1605, NULL, "\"%s\": the chain has no stage \"%s\"", f->text, stage);
	if (node && !AMONG(node, r->nodes, r->n_nodes))
		return bb_fail(err, BB_ERR_CONFIG, 1605, NULL, "\"%s\": the room has no node \"%s\"", f->text, node);
	return BB_OK;
}

static enum bb_status resolve(struct sim_world *w, const struct sim_fault *f, const struct sim_verb **verb,
                              struct bb_error *err)
{
	const struct sim_verb *verbs = NULL;

	if (!sim_world_find(w, f->class_name, f->id, &verbs)) {
		if (in_room(w->room, f->class_name, f->id))
			return bb_fail(err, BB_ERR_CONFIG, 1606, NULL, "\"%s\": %s/%s is not open", f->text,
			               f->class_name, f->id);
		return bb_fail(err, BB_ERR_CONFIG, 1604, NULL, "\"%s\": the room has no %s \"%s\"", f->text,
		               f->class_name, f->id);
	}
	*verb = verb_of(verbs, f->verb);
	if (!*verb)
		return bb_fail(err, BB_ERR_CONFIG, 1602, NULL, "\"%s\": %s has no verb \"%s\"", f->text, f->class_name,
		               f->verb);
	return check_names(w->room, f, err);
}

/* The device is looked up each time: it may have been closed and opened again since. */
static void apply(struct sim_planted *p, bool on, int64_t at_ns)
{
	struct sim_world *w = p->world;
	void *device = sim_world_find(w, p->fault->class_name, p->fault->id, NULL);

	p->status = device ? p->verb->apply(device, &p->fault->args, on, NULL) : BB_ERR_LOST;
	if (on)
		p->set_ns = at_ns;
	else
		p->cleared_ns = at_ns;
	bb_eventlog_add(w->events, w->fault_source, BB_EV_FAULT, at_ns, p - w->planted, on);
}

static int64_t step(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns)
{
	struct sim_planted *p = bb_container_of(timer, struct sim_planted, timer);
	const struct sim_fault *f = p->fault;
	int64_t for_ns = f->for_ns;

	(void)now_ns;
	if (p->set_ns != BB_NEVER) {
		apply(p, false, scheduled_ns);
		return BB_NEVER;
	}
	apply(p, true, scheduled_ns);
	if (f->for_frames > 0 && f->for_frames < BB_NEVER / p->world->frame_ns)
		for_ns = f->for_frames * p->world->frame_ns;
	return for_ns < BB_NEVER - scheduled_ns ? scheduled_ns + for_ns : BB_NEVER;
}

void sim_faults_forget(struct sim_world *w)
{
	for (size_t i = 0; i < w->n_planted; i++)
		bb_clock_disarm(w->clk, &w->planted[i].timer);
	free(w->planted);
	w->planted = NULL;
	w->n_planted = 0;
}

static enum bb_status plant_boot(struct sim_world *w, struct sim_planted *p)
{
	const int64_t now_ns = bb_clock_now_ns(w->clk);
	const int64_t clear_ns = step(&p->timer, now_ns, now_ns);

	return clear_ns == BB_NEVER ? BB_OK : bb_clock_arm(w->clk, &p->timer, clear_ns);
}

enum bb_status sim_faults_plant(struct sim_world *w, const struct sim_fault *faults, size_t n, int64_t frame_ns,
                                struct bb_error *err)
{
	enum bb_status status = BB_OK;

	if (w->planted || frame_ns <= 0)
		return BB_ERR_USAGE;
	if (n > SIM_FAULTS_MAX)
		return bb_fail(err, BB_ERR_CONFIG, 1607, NULL, "%zu faults, a run has at most %d", n, SIM_FAULTS_MAX);
	w->frame_ns = frame_ns;
	w->planted = calloc(n ? n : 1, sizeof(*w->planted));
	if (!w->planted)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "%zu faults", n);
	w->n_planted = n;
	for (size_t i = 0; i < n; i++) {
		w->planted[i] = (struct sim_planted){ .world = w, .fault = &faults[i], .set_ns = BB_NEVER,
			                              .cleared_ns = BB_NEVER, .timer = { .step = step } };
		if (status == BB_OK)
			status = resolve(w, &faults[i], &w->planted[i].verb, err);
	}
	for (size_t i = 0; i < n && status == BB_OK; i++)
		if (faults[i].at_boot)
			status = plant_boot(w, &w->planted[i]);
	if (status != BB_OK)
		sim_faults_forget(w);
	return status;
}

enum bb_status sim_faults_start(struct sim_world *w)
{
	enum bb_status status = BB_OK;

	for (size_t i = 0; i < w->n_planted && status == BB_OK; i++)
		if (!w->planted[i].fault->at_boot)
			status = bb_clock_arm(w->clk, &w->planted[i].timer,
			                      w->scene_start_ns + w->planted[i].fault->at_ns);
	return status;
}

bool sim_fault_state(const struct sim_world *w, size_t i, struct sim_fault_state *out)
{
	if (i >= w->n_planted)
		return false;
	out->set_ns = w->planted[i].set_ns;
	out->cleared_ns = w->planted[i].cleared_ns;
	out->status = w->planted[i].status;
	return true;
}
