/* bench/cmd/track_calibrate.c: `track calibrate ROOM`: cameras from a wand dance, recorded or simulated. docs/calibration.md. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bench/calibrate/tell.h"
#include "bench/cli.h"
#include "hal/clock.h"

struct job {
	const struct bb_cli *cli;
	struct bb_room *room;
	struct bb_dance dance;
	struct bb_sequence recorded;
	struct bb_camera_config *planned; /* in the sequence's order */
	struct bb_calibrate_outcome outcome;
	struct bb_calibration calibration;
};

static enum bb_status camera_named(const struct bb_room *room, const char *id, int *out, struct bb_error *err)
{
	*out = -1;
	for (size_t i = 0; id && i < room->n_cameras; i++)
		if (!strcmp(room->cameras[i].id, id))
			*out = (int)i;
	return !id || *out >= 0 ? BB_OK : bb_fail(err, BB_ERR_USAGE, 1701, NULL, "--knock %s: the room has no such camera", id);
}

static enum bb_status simulate(struct job *j, struct bb_error *err)
{
	double seconds = 90, noise = 0.1, percent = 0, cameras = 0, seed = 1;
	struct bb_dance_config c = { .room = j->room, .rate_hz = 50 };
	enum bb_status status = bb_cli_number(j->cli, "seconds", 90, 5, 600, &seconds, err);

	if (!status)
		status = bb_cli_number(j->cli, "noise-px", 0.1, 0.001, 5, &noise, err);
	if (!status)
		status = bb_cli_number(j->cli, "outliers", 0, 0, 40, &percent, err);
	if (!status)
		status = bb_cli_whole(j->cli, "cameras", (double)j->room->n_cameras, 2, 256, &cameras, err);
	if (!status)
		status = bb_cli_whole(j->cli, "seed", 1, 0, 9007199254740992.0, &seed, err);
	if (!status)
		status = camera_named(j->room, bb_cli_get(j->cli, "knock", NULL), &c.knocked, err);
	if (status)
		return status;
	c.seconds = seconds;
	c.noise_px = j->outcome.noise_px = noise;
	c.outlier_share = percent / 100;
	c.n_cameras = (size_t)cameras;
	c.seed = (uint64_t)seed;
	status = bb_dance_make(&c, &j->dance);
	if (status)
		return bb_fail(err, status, 1702, NULL, "a simulated dance");
	j->outcome.dance = &j->dance;
	j->outcome.sequence = &j->dance.sequence;
	return BB_OK;
}

/* The room's cameras in the sequence's order; every one of them must be there, unless the sequence was simulated. */
static enum bb_status match_cameras(struct job *j, struct bb_error *err)
{
	const struct bb_sequence *s = j->outcome.sequence;

	j->planned = calloc(s->n_cameras + 1, sizeof(*j->planned));
	if (!j->planned)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "cameras");
	for (size_t i = 0; i < s->n_cameras; i++) {
		size_t k = 0;
		while (k < j->room->n_cameras && strcmp(j->room->cameras[k].id, s->ids[i]) != 0)
			k++;
		if (k == j->room->n_cameras)
			return bb_fail(err, BB_ERR_CONFIG, 1733, NULL, "'%s' is not in the room", s->ids[i]);
		j->planned[i] = j->room->cameras[k];
	}
	if (!j->outcome.dance && s->n_cameras != j->room->n_cameras)
		return bb_fail(err, BB_ERR_CONFIG, 1733, NULL, "%zu of the room's %zu cameras", s->n_cameras, j->room->n_cameras);
	j->outcome.planned = j->planned;
	return BB_OK;
}

static enum bb_status adjust(struct job *j, struct bb_error *err)
{
	const struct bb_calibrate_config config = { .cameras = j->planned,
		                                    .n_cameras = j->outcome.sequence->n_cameras,
		                                    .sequence = j->outcome.sequence };
	const int64_t from_ns = bb_clock_stopwatch_ns();
	const enum bb_status status = bb_calibrate(&config, &j->calibration, err);

	j->outcome.seconds = (double)(bb_clock_stopwatch_ns() - from_ns) * 1e-9;
	j->outcome.calibration = &j->calibration;
	if (!status)
		bb_calibrate_judge(&j->outcome);
	return status;
}

static enum bb_status save(struct job *j, struct bb_error *err)
{
	const char *out = bb_cli_get(j->cli, "out", NULL), *sequence = bb_cli_get(j->cli, "save", NULL);
	const char *pictures[] = { bb_cli_get(j->cli, "svg", NULL), bb_cli_get(j->cli, "png", NULL) };
	struct bb_calibration_head head;
	char today[32];
	enum bb_status status = BB_OK;

	if (out && j->calibration.n_cameras != j->room->n_cameras)
		return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "--out needs all cameras of the room; leave out --cameras");
	bb_clock_today(today);
	bb_calibrate_head(j->room, bb_cli_get(j->cli, "date", j->outcome.dance ? "simulated" : today), &head);
	if (!j->outcome.dance)
		bb_hash_hex(j->recorded.sha256, head.sequence_sha256);
	head.rms_px = j->calibration.rms_px;
	if (sequence)
		status = bb_calibrate_save_sequence(sequence, j->outcome.sequence, err);
	for (size_t i = 0; i < j->calibration.n_cameras; i++)
		j->calibration.cameras[i].calibrated_px = j->calibration.report[i].rms_px;
	if (!status && out)
		status = bb_calibrate_save(out, &head, j->calibration.cameras, j->calibration.n_cameras, err);
	for (size_t i = 0; i < BB_ARRAY_LEN(pictures); i++)
		if (!status && pictures[i])
			status = bb_calibrate_draw(&j->outcome, pictures[i], err);
	return status;
}

static int tell(struct job *j)
{
	const int code = j->outcome.dance && !j->outcome.holds ? BB_EXIT_FAILED : BB_EXIT_OK;

	if (bb_cli_has(j->cli, "json")) {
		const int printed = bb_cli_print_json(bb_calibrate_json(&j->outcome));
		return printed ? printed : code;
	}
	bb_calibrate_print(&j->outcome, stdout);
	return code;
}

static int run(const struct bb_cli *cli)
{
	static const char *const simulated[] = { "seconds", "noise-px", "outliers", "knock", "cameras", "seed", "save" };
	struct job j = { .cli = cli };
	struct bb_error err = { 0 };
	const char *file = bb_cli_get(cli, "sequence", NULL);
	enum bb_status status = BB_OK;

	if (!file == !bb_cli_has(cli, "simulate"))
		status = bb_fail(&err, BB_ERR_USAGE, 1701, NULL, "either --sequence FILE or --simulate");
	for (size_t i = 0; !status && file && i < BB_ARRAY_LEN(simulated); i++)
		if (bb_cli_has(cli, simulated[i]))
			status = bb_fail(&err, BB_ERR_USAGE, 1701, NULL, "--%s belongs to --simulate", simulated[i]);
	if (!status)
		status = bb_calibrate_spare(cli, cli->arg[0], &err);
	if (!status)
		status = bb_calibrate_spare(cli, file, &err);
	if (!status)
		status = bb_room_load_planned(cli->arg[0], &j.room, &err);
	j.outcome.room = j.room;
	if (!status && j.room->n_cameras < 2)
		status = bb_fail(&err, BB_ERR_CONFIG, 1733, NULL, "'%s' has fewer than two cameras", j.room->name);
	if (!status && file) {
		status = bb_sequence_read(file, &j.recorded, &err);
		j.outcome.sequence = &j.recorded;
	} else if (!status) {
		status = simulate(&j, &err);
	}
	if (!status)
		status = match_cameras(&j, &err);
	if (!status)
		status = adjust(&j, &err);
	if (!status)
		status = save(&j, &err);
	const int code = status ? bb_cli_fail(status, &err) : tell(&j);
	bb_calibration_free(&j.calibration);
	bb_sequence_free(&j.recorded);
	bb_dance_free(&j.dance);
	free(j.planned);
	bb_room_free(j.room);
	return code;
}

static const struct bb_cli_option options[] = {
	{ "sequence", "FILE", "what the cameras saw of square and wand" },
	{ "simulate", NULL, "a dance in this room, its cameras hung decimetres and degrees off" },
	{ "seconds", "N", "of the simulated dance: 90 when left out" },
	{ "noise-px", "N", "of a simulated blob, each axis: 0.1 when left out" },
	{ "outliers", "PERCENT", "of the simulated markers are wrong: 0 when left out" },
	{ "knock", "CAMERA", "is knocked half way through the simulated dance" },
	{ "cameras", "N", "only the first N, simulated" },
	{ "seed", "N", "of every random number: 1 when left out" },
	{ "save", "FILE", "the simulated sequence as a file" },
	{ "out", "FILE", "the calibration, for `calibration: FILE` in the room" },
	{ "date", "TEXT", "stands in it; today when left out" },
	{ "svg", "FILE", "draw what is left over, camera by camera" },
	{ "png", "FILE", "the same as a picture of pixels" },
	{ "json", NULL, "everything as JSON" },
	{ NULL, NULL, NULL },
};

const struct bb_command bb_cmd_track_calibrate = { "track calibrate",
	                                           "lenses, places and directions of cameras from a wand dance",
	                                           "ROOM --sequence FILE|--simulate [--out FILE] [--png FILE] [--json]",
	                                           options, 1, 1, run };
