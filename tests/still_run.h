/*
 * tests/still_run.h: a run under planted faults, of a scene of the test or of nothing but white walls: what moves there is
 * what the faults moved, and on anything darker less would flash.
 */
#ifndef BB_TESTS_STILL_RUN_H
#define BB_TESTS_STILL_RUN_H

#include "bench/run.h"
#include "tests/fixture_room.h"

#include <unistd.h>

#define STILL_SCENE                                                                                                    \
	"scene: white\ntechnique: calibration\nduration_s: 10\nneeds: {shutters: 1, displays: 1}\n"                   \
	"patch: {hz: 1, size_m: 0, low_percent: 100, high_percent: 100}\n"

static inline void plant(struct sim_fault *f, size_t *n, const char *text)
{
	struct bb_error err = { 0 };

	if (sim_fault_parse(text, &f[(*n)++], NULL, &err) != BB_OK)
		fail_msg("%s: %s", text, err.text);
}

static inline struct bb_run_options still_options(const char *room, const struct sim_fault *f, size_t n)
{
	struct bb_run_options o = bb_run_options_default();

	o.room_path = room;
	o.pictures = false;
	o.faults = f;
	o.n_faults = n;
	return o;
}

/* The caller frees *run. */
static inline void scene_run(const char *scene, struct bb_run_options o, struct bb_run *run)
{
	char path[] = "/tmp/bb_still_XXXXXX.yaml";
	const int fd = mkstemps(path, 5);
	struct bb_error err = { 0 };

	assert_true(fd >= 0);
	assert_int_equal(write(fd, scene, strlen(scene)), strlen(scene));
	close(fd);
	o.scene_path = path;
	const enum bb_status status = bb_run(&o, run, &err);
	unlink(path);
	if (status != BB_OK)
		fail_msg("seed %llu: %s", (unsigned long long)o.seed, err.text);
}

static inline void still_run(struct bb_run_options o, struct bb_run *run)
{
	scene_run(STILL_SCENE, o, run);
}

/* The first incident that begins with the word. */
static inline const struct bb_incident *incident_named(const struct bb_incident *incident, size_t n, const char *word)
{
	for (size_t i = 0; i < n; i++)
		if (!strncmp(incident[i].what, word, strlen(word)))
			return &incident[i];
	for (size_t i = 0; i < n; i++)
		printf("  %s %s: %s\n", incident[i].culprit, incident[i].state, incident[i].what);
	fail_msg("nothing is named %s", word);
	return NULL;
}

static inline uint64_t counted(const struct bb_run_result *r, const char *name)
{
	for (size_t i = 0; i < r->n_counters; i++)
		if (!strcmp(r->counters[i].name, name))
			return r->counters[i].value;
	return 0;
}

#endif
