/* bench/cmd/track_align.c: `track align ROOM --touched FILE`: tracker space onto the walls' corners. docs/calibration.md. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bench/calibrate/tell.h"
#include "bench/cli.h"
#include "bench/file.h"
#include "hal/clock.h"
#include "sync/calibrate/touch.h"

#define FILE_BYTES_MAX 65536
#define MOST_MM 20.0

struct touched {
	size_t n;
	struct bb_vec3 tracker[BB_TOUCHES_MAX], room[BB_TOUCHES_MAX];
	char name[BB_TOUCHES_MAX][2 * BB_ID_MAX];
};

static bool corner_of(const struct bb_corners *c, const char *word, struct bb_vec3 *out)
{
	static const struct {
		const char *name;
		double u, v;
	} corners[] = { { "lower_left", 0, 0 }, { "lower_right", 1, 0 }, { "upper_left", 0, 1 }, { "upper_right", 1, 1 } };

	for (size_t i = 0; i < BB_ARRAY_LEN(corners); i++)
		if (!strcmp(word, corners[i].name)) {
			*out = bb_corners_at(c, corners[i].u, corners[i].v);
			return true;
		}
	return false;
}

/* "WALL CORNER x y z"; NULL when good. */
static const char *take(const struct bb_room *room, char *line, struct touched *t)
{
	char *rest = NULL, *end;
	const char *wall = strtok_r(line, " \t\r", &rest), *corner = strtok_r(NULL, " \t\r", &rest);
	double x[3];

	if (!wall || wall[0] == '#')
		return NULL;
	const int w = bb_room_wall(room, wall);
	if (w < 0 || !corner || !corner_of(&room->walls[w].corners, corner, &t->room[t->n < BB_TOUCHES_MAX ? t->n : 0]))
		return w < 0 ? "no such wall" : "lower_left, lower_right, upper_left or upper_right of the wall wanted";
	for (int i = 0; i < 3; i++) {
		const char *word = strtok_r(NULL, " \t\r", &rest);
		if (!word || word[strspn(word, "0123456789+-.eE")])
			return "three numbers in metres wanted";
		x[i] = strtod(word, &end);
		if (*end || !(fabs(x[i]) <= 1000))
			return "not a number of metres";
	}
	if (strtok_r(NULL, " \t\r", &rest))
		return "more than three numbers";
	if (t->n == BB_TOUCHES_MAX)
		return "more than 64 points";
	snprintf(t->name[t->n], sizeof(t->name[t->n]), "%.31s %.15s", wall, corner);
	for (size_t i = 0; i < t->n; i++)
		if (!strcmp(t->name[i], t->name[t->n]))
			return "the same corner twice";
	t->tracker[t->n++] = (struct bb_vec3){ x[0], x[1], x[2] };
	return NULL;
}

static enum bb_status read_touched(const char *path, const struct bb_room *room, struct touched *t, struct bb_error *err)
{
	struct bb_where where = { path, 1, 0 };
	char *text = NULL, *rest = NULL;
	size_t n = 0;
	enum bb_status status = bb_file_read(path, FILE_BYTES_MAX, &text, &n, err);

	if (!status)
		status = bb_file_check_text(path, text, n, err);
	for (char *line = text; !status && line; line = rest, where.line++) {
		rest = strchr(line, '\n');
		if (rest)
			*rest++ = 0;
		const char *wrong = take(room, line, t);
		if (wrong)
			status = bb_fail(err, BB_ERR_CONFIG, 1740, &where, "%s", wrong);
	}
	free(text);
	return status;
}

static enum bb_status fit(const struct touched *t, double most_mm, struct bb_touch_fit *out, struct bb_error *err)
{
	if (!bb_touch_fit(t->tracker, t->room, t->n, out))
		return bb_fail(err, BB_ERR_CONFIG, 1741, NULL, "%zu corners", t->n);
	if (out->off_m[out->worst] > most_mm * 1e-3)
		return bb_fail(err, BB_ERR_CONFIG, 1742, NULL, "%s is %.1f mm off, %g are allowed", t->name[out->worst],
		               1e3 * out->off_m[out->worst], most_mm);
	return BB_OK;
}

/* What was danced for must not go for a plan that was moved: the room names no calibration, and there is one at --out. */
static enum bb_status spare_dance(const char *out, struct bb_room *planned, struct bb_error *err)
{
	struct bb_calibration_head there;
	struct bb_error none = { 0 };

	if (bb_calibration_read(out, planned->cameras, planned->n_cameras, &there, &none) || !(there.rms_px > 0))
		return BB_OK;
	return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "--out %s is a calibration that the room does not name: it would be lost", out);
}

/* Everything moves with the tracker's space. */
static enum bb_status save(const struct bb_cli *cli, struct bb_room *room, const struct bb_touch_fit *f, struct bb_error *err)
{
	struct bb_calibration_head head;
	struct bb_room *planned = NULL;
	char today[32];
	const char *out = bb_cli_get(cli, "out", NULL);
	enum bb_status status = out ? bb_room_load_planned(cli->arg[0], &planned, err) : BB_OK;

	if (!out || status)
		return status;
	bb_clock_today(today);
	bb_calibrate_head(planned, bb_cli_get(cli, "date", today), &head);
	if (*room->calibration) { /* what it came from stays known */
		struct bb_calibration_head old;
		status = bb_calibration_read(room->calibration, planned->cameras, planned->n_cameras, &old, err);
		head.rms_px = old.rms_px;
		head.moved = old.moved;
		memcpy(head.sequence_sha256, old.sequence_sha256, sizeof(head.sequence_sha256));
	} else {
		status = spare_dance(out, planned, err);
	}
	head.moved = bb_pose_mul(&f->pose, &head.moved);
	for (size_t i = 0; i < room->n_cameras; i++) {
		room->cameras[i].pose = bb_pose_mul(&f->pose, &room->cameras[i].pose);
		room->cameras[i].pose.q = bb_quat_unit(room->cameras[i].pose.q);
	}
	if (!status)
		status = bb_calibrate_save(out, &head, room->cameras, room->n_cameras, err);
	bb_room_free(planned);
	return status;
}

static int tell(const struct bb_cli *cli, const struct touched *t, const struct bb_touch_fit *f)
{
	const double turned_deg = bb_quat_angle(f->pose.q, BB_QUAT_IDENTITY) * (180 / 3.14159265358979323846);
	json_t *points = json_array();

	for (size_t i = 0; i < t->n; i++)
		json_array_append_new(points, json_pack("{s:s, s:f}", "corner", t->name[i], "off_mm", 1e3 * f->off_m[i]));
	if (bb_cli_has(cli, "json"))
		return bb_cli_print_json(json_pack("{s:o, s:[fff], s:[ffff], s:f, s:f, s:f}", "points", points, "moved_m", f->pose.p.x,
		                                   f->pose.p.y, f->pose.p.z, "turned", f->pose.q.x, f->pose.q.y, f->pose.q.z,
		                                   f->pose.q.w, "rms_mm", 1e3 * f->rms_m, "sigma_mm", 1e3 * f->sigma_m,
		                                   "sigma_deg", f->sigma_deg));
	json_decref(points);
	for (size_t i = 0; i < t->n; i++)
		printf("  %-32s %7.2f mm off\n", t->name[i], 1e3 * f->off_m[i]);
	printf("  tracker space moves by [%.4f, %.4f, %.4f] m and turns by %.3f degrees\n", f->pose.p.x, f->pose.p.y, f->pose.p.z,
	       turned_deg);
	printf("  %.2f mm rms per coordinate; known to %.2f mm among these points, and to %.3f degrees\n", 1e3 * f->rms_m,
	       1e3 * f->sigma_m, f->sigma_deg);
	return BB_EXIT_OK;
}

static int run(const struct bb_cli *cli)
{
	const char *file = bb_cli_get(cli, "touched", NULL);
	struct bb_error err = { 0 };
	struct bb_room *room = NULL;
	struct touched t = { .n = 0 };
	struct bb_touch_fit f = { .worst = 0 };
	double most_mm = MOST_MM;
	enum bb_status status = file ? BB_OK : bb_fail(&err, BB_ERR_USAGE, 1701, NULL, "--touched FILE is missing");

	if (!status)
		status = bb_cli_number(cli, "most-mm", MOST_MM, 0.1, 1000, &most_mm, &err);
	if (!status)
		status = bb_calibrate_spare(cli, cli->arg[0], &err);
	if (!status)
		status = bb_calibrate_spare(cli, file, &err);
	if (!status)
		status = bb_room_load(cli->arg[0], &room, &err);
	if (!status)
		status = read_touched(file, room, &t, &err);
	if (!status)
		status = fit(&t, most_mm, &f, &err);
	if (!status)
		status = save(cli, room, &f, &err);
	bb_room_free(room);
	return status ? bb_cli_fail(status, &err) : tell(cli, &t, &f);
}

static const struct bb_cli_option options[] = {
	{ "touched", "FILE", "lines such as `front lower_left -1.524 0.001 -1.523`" },
	{ "most-mm", "N", "a corner may be off: 20 when left out" },
	{ "out", "FILE", "the calibration, moved, for `calibration: FILE` in the room" },
	{ "date", "TEXT", "stands in it; today when left out" },
	{ "json", NULL, "everything as JSON" },
	{ NULL, NULL, NULL },
};

const struct bb_command bb_cmd_track_align = { "track align", "tracker space onto the walls, from touched corners",
	                                       "ROOM --touched FILE [--out FILE] [--json]", options, 1, 1, run };
