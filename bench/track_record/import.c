/* bench/track_record/import.c: twice through the file: who is in it, then where they were. See import.h. */
#include "bench/track_record/import.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "bench/track_record/replay.h"
#include "drivers/mocap/natnet.h"
#include "hal/bytes.h"

struct work {
	const char *path;
	FILE *in;
	struct bb_import *out;
	int32_t id[BB_BODIES_MAX];
	struct bb_recorder *recorder; /* NULL: into the table */
	struct bb_file csv;
	uint64_t n_good;              /* datagrams before the first that is none */
	struct bb_record_head head;
	struct natnet_message m;
	uint8_t bytes[NATNET_DATAGRAM_MOST];
};

/* The next datagram; BB_SKIPPED: there is none. */
static enum bb_status next(struct work *w, struct bb_error *err)
{
	const struct bb_where where = { w->path, 0, 0 };
	const long at = ftell(w->in);
	const size_t n_head = fread(w->bytes, 1, NATNET_HEADER_BYTES, w->in);
	const char *why = "it ends in the middle of a datagram";
	size_t n = 0;

	if (!n_head)
		return BB_SKIPPED;
	if (n_head == NATNET_HEADER_BYTES)
		n = (size_t)bb_get_le(w->bytes + 2, 2);
	if (n > sizeof(w->bytes) - NATNET_HEADER_BYTES)
		why = "longer than a datagram can be";
	else if (n_head == NATNET_HEADER_BYTES && fread(w->bytes + NATNET_HEADER_BYTES, 1, n, w->in) == n &&
	         natnet_read(w->bytes, NATNET_HEADER_BYTES + n, &w->m, &why))
		return BB_OK;
	return bb_fail(err, BB_ERR_FORMAT, 1767, &where, "at byte %ld: %s", at, why);
}

static int body_of(const struct work *w, int32_t id)
{
	for (size_t i = 0; i < w->out->n_bodies; i++)
		if (w->id[i] == id)
			return (int)i;
	return -1;
}

static void meet(struct work *w, int32_t id, const char *name)
{
	const int known = body_of(w, id);
	char text[BB_ID_MAX];

	if (known < 0 && w->out->n_bodies == BB_BODIES_MAX)
		return;
	const size_t i = known < 0 ? w->out->n_bodies++ : (size_t)known;
	if (name)
		bb_record_word(w->out->body[i], name);
	else if (known < 0)
		snprintf(w->out->body[i], sizeof(w->out->body[i]), "body%d", (int)id);
	w->id[i] = id;
	snprintf(text, sizeof(text), "%s", w->out->body[i]);
	memcpy(w->head.body[i].id, text, sizeof(text));
}

static void meet_all(struct work *w)
{
	if (w->m.id == NATNET_MODELS)
		for (int32_t i = 0; i < w->m.models.n; i++)
			if (w->m.models.model[i].kind == NATNET_RIGID_BODY)
				meet(w, w->m.models.model[i].id, w->m.models.model[i].name);
	if (w->m.id == NATNET_FRAME)
		for (int32_t i = 0; i < w->m.frame.n_bodies; i++)
			meet(w, w->m.frame.body[i].id, NULL);
}

static bool is_a_pose(const struct natnet_rigid_body *b)
{
	double q2 = 0;
	bool ok = isfinite(b->error) && b->error >= 0;

	for (int i = 0; i < 3; i++)
		ok = ok && fabsf(b->at[i]) < 1e5F;
	for (int i = 0; i < 4; i++)
		q2 += (double)b->q[i] * (double)b->q[i];
	return ok && fabs(q2 - 1) < 1e-2;
}

static void put_pose(struct work *w, size_t body, int64_t at_ns, const struct natnet_rigid_body *b)
{
	const struct bb_quat q = { (double)b->q[0], (double)b->q[1], (double)b->q[2], (double)b->q[3] };
	struct bb_record_item item = { .kind = BB_RECORD_POSE, .pose.body = (uint16_t)body };
	struct bb_track_solution *s = &item.pose.solution;

	s->at_ns = at_ns;
	s->body.p = (struct bb_vec3){ (double)b->at[0], (double)b->at[1], (double)b->at[2] };
	s->body.q = bb_quat_unit(q);
	s->position_sigma_mm = (double)b->error * 1e3; /* Motive's mean marker error: the nearest it tells */
	for (int32_t i = 0; i < w->m.frame.n_markers; i++)
		s->n_markers = (uint16_t)(s->n_markers + (w->m.frame.marker[i].id >> 16 == b->id &&
		                                          !(w->m.frame.marker[i].params & NATNET_OCCLUDED)));
	if (w->recorder)
		bb_recorder_put(w->recorder, &item);
	else
		bb_poses_csv_row(w->csv.out, w->out->body[body], s);
	w->out->poses++;
}

static void put_frame(struct work *w)
{
	const struct natnet_frame *f = &w->m.frame;
	const double at_s = f->timestamp_s >= 0 && f->timestamp_s < 1e9 ? f->timestamp_s : 0;
	const int64_t at_ns = llround(at_s * 1e9);
	const struct bb_record_item solve = { .kind = BB_RECORD_SOLVE, .now_ns = at_ns };

	w->out->frames++;
	if (w->recorder)
		bb_recorder_put(w->recorder, &solve);
	for (int32_t i = 0; i < f->n_bodies; i++) {
		const int body = body_of(w, f->body[i].id);
		if (body < 0)
			w->out->left_out++;
		else if (!(f->body[i].params & NATNET_TRACKED) || !is_a_pose(&f->body[i]))
			w->out->untracked++;
		else
			put_pose(w, (size_t)body, at_ns, &f->body[i]);
	}
}

static enum bb_status begin(struct work *w, const char *out_path, struct bb_error *err)
{
	const size_t n = strlen(out_path);

	if (n > 4 && !strcmp(out_path + n - 4, ".csv")) {
		const enum bb_status status = bb_file_begin(&w->csv, out_path, err);
		if (status == BB_OK)
			bb_poses_csv_head(w->csv.out);
		return status;
	}
	snprintf(w->head.room, sizeof(w->head.room), "imported");
	snprintf(w->head.sha256, sizeof(w->head.sha256), "-");
	w->head.n_bodies = w->out->n_bodies;
	return bb_recorder_create(out_path, &w->head, &w->recorder, err);
}

static enum bb_status end(struct work *w, struct bb_error *err)
{
	struct bb_recorder *r = w->recorder;

	w->recorder = NULL;
	return r ? bb_recorder_commit(r, err) : bb_file_commit(&w->csv, err);
}

static enum bb_status import(struct work *w, const char *out_path, struct bb_error *err)
{
	struct bb_error unused = { 0 };
	enum bb_status status;

	while ((status = next(w, err)) == BB_OK) {
		w->n_good++;
		meet_all(w);
	}
	w->out->truncated = status < 0;
	if (!w->n_good)
		return status < 0 ? status : bb_fail(err, BB_ERR_FORMAT, 1767, NULL, "%s is empty", w->path);
	rewind(w->in);
	struct bb_error own = { 0 }; /* where it stopped stands in err already */
	status = begin(w, out_path, &own);
	for (; status == BB_OK && w->out->datagrams < w->n_good && next(w, &unused) == BB_OK; w->out->datagrams++)
		if (w->m.id == NATNET_FRAME)
			put_frame(w);
	if (status == BB_OK)
		status = end(w, &own);
	if (status != BB_OK)
		*err = own;
	return status;
}

enum bb_status bb_import_natnet(const char *path, const char *out_path, struct bb_import *out, struct bb_error *err)
{
	const struct bb_where where = { path, 0, 0 };
	struct work *w = calloc(1, sizeof(*w));
	enum bb_status status;
	struct stat st;

	*out = (struct bb_import){ 0 };
	if (!w)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "the import");
	w->path = path;
	w->out = out;
	w->in = stat(path, &st) == 0 && S_ISREG(st.st_mode) ? fopen(path, "rb") : NULL;
	if (w->in)
		status = import(w, out_path, err);
	else
		status = bb_fail(err, BB_ERR_IO, 1001, &where, "%s", errno ? strerror(errno) : "not a regular file");
	bb_recorder_abort(w->recorder);
	bb_file_abort(&w->csv);
	if (w->in)
		fclose(w->in);
	free(w);
	return status;
}
