/* bench/track_record/recorder.c: lines into a file, see record.h. */
#include "bench/track_record/record.h"

#include <inttypes.h>
#include <math.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>
#include <zstd.h>

#include "hal/hash.h"

#define PACK_LEVEL 3
#define OUT_BYTES 65536
#define FLUSH_BYTES 65536 /* of text */

struct bb_recorder {
	struct bb_file file;
	ZSTD_CStream *pack;      /* NULL: plain text */
	bool failed;
	uint64_t n_frames, n_poses;
	size_t n, n_unflushed;
	char line[BB_RECORD_LINE];
	uint8_t out[OUT_BYTES];
};

void bb_record_word(char out[BB_ID_MAX], const char *text)
{
	size_t n = 0;

	for (; n < BB_ID_MAX - 1 && text[n]; n++)
		out[n] = text[n] > ' ' && text[n] < 127 ? text[n] : '_';
	if (!n)
		out[n++] = '_';
	out[n] = '\0';
}

void bb_record_head_of(struct bb_record_head *h, const struct bb_room *room, const struct bb_tracker_config *tracker)
{
	memset(h, 0, sizeof(*h));
	snprintf(h->room, sizeof(h->room), "%s", room->name);
	bb_hash_hex(room->sha256, h->sha256);
	h->n_bodies = room->n_bodies;
	memcpy(h->body, room->bodies, sizeof(h->body));
	h->n_cameras = room->n_cameras < BB_RECORD_CAMERAS_MAX ? room->n_cameras : BB_RECORD_CAMERAS_MAX;
	for (size_t i = 0; i < h->n_cameras; i++)
		bb_record_word(h->camera[i], room->cameras[i].id);
	h->n_pads = room->n_gamepads < BB_RECORD_PADS_MAX ? room->n_gamepads : BB_RECORD_PADS_MAX;
	for (size_t i = 0; i < h->n_pads; i++)
		bb_record_word(h->pad[i], room->gamepads[i].id);
	if (!tracker)
		return;
	h->has_tracker = true;
	h->sigma_px = tracker->blob_sigma_px;
	h->group_ns = tracker->group_ns;
	h->freeze_ns = tracker->freeze_ns;
	h->room_min = tracker->room_min;
	h->room_max = tracker->room_max;
	h->neutral = tracker->neutral;
}

/* ---- bytes ---- */

static void write_out(struct bb_recorder *r, size_t n)
{
	if (fwrite(r->out, 1, n, r->file.out) != n)
		r->failed = true;
}

static void pack(struct bb_recorder *r, ZSTD_EndDirective how)
{
	ZSTD_inBuffer in = { r->line, r->n, 0 };
	size_t left;

	do {
		ZSTD_outBuffer out = { r->out, sizeof(r->out), 0 };
		left = ZSTD_compressStream2(r->pack, &out, &in, how);
		if (ZSTD_isError(left)) {
			r->failed = true;
			return;
		}
		write_out(r, out.pos);
	} while (in.pos < in.size || (how != ZSTD_e_continue && left));
}

static void flush_line(struct bb_recorder *r)
{
	/* Whoever is killed leaves a file that can be read up to its last flush. */
	const bool flush = (r->n_unflushed += r->n) > FLUSH_BYTES;
	if (flush)
		r->n_unflushed = 0;
	if (r->pack)
		pack(r, flush ? ZSTD_e_flush : ZSTD_e_continue);
	else if (fwrite(r->line, 1, r->n, r->file.out) != r->n)
		r->failed = true;
	if (flush && fflush(r->file.out))
		r->failed = true;
	r->n = 0;
}

/* A piece of a line; a '\n' at its end ends the line. */
BB_PRINTF(2, 3)
static void put(struct bb_recorder *r, const char *fmt, ...)
{
	va_list args;

	va_start(args, fmt);
	const int n = vsnprintf(r->line + r->n, sizeof(r->line) - r->n, fmt, args);
	va_end(args);
	if (n < 0 || (size_t)n >= sizeof(r->line) - r->n) { /* its size is made for the longest line there is */
		r->failed = true;
		return;
	}
	r->n += (size_t)n;
	if (n && r->line[r->n - 1] == '\n')
		flush_line(r);
}

/* ---- lines ---- */

static void put_vec(struct bb_recorder *r, struct bb_vec3 v)
{
	put(r, " %.17g %.17g %.17g", v.x, v.y, v.z);
}

static void put_quat(struct bb_recorder *r, struct bb_quat q)
{
	put(r, " %.17g %.17g %.17g %.17g", q.x, q.y, q.z, q.w);
}

static void put_head(struct bb_recorder *r, const struct bb_record_head *h)
{
	char word[BB_ID_MAX];

	bb_record_word(word, h->room);
	put(r, "blackburst-track 1\nroom %s %s\n", word, h->sha256);
	if (h->has_tracker) {
		put(r, "tracker %.17g %" PRId64 " %" PRId64, h->sigma_px, h->group_ns, h->freeze_ns);
		put_vec(r, h->room_min);
		put_vec(r, h->room_max);
		put_vec(r, h->neutral.p);
		put_quat(r, h->neutral.q);
		put(r, "\n");
	}
	for (size_t i = 0; i < h->n_cameras; i++)
		put(r, "camera %s\n", h->camera[i]);
	for (size_t i = 0; i < h->n_bodies; i++) {
		bb_record_word(word, h->body[i].id);
		put(r, "body %s %zu", word, h->body[i].n_markers);
		for (size_t m = 0; m < h->body[i].n_markers; m++)
			put_vec(r, h->body[i].marker[m]);
		put_vec(r, h->body[i].eye_centre);
		put(r, "\n");
	}
	for (size_t i = 0; i < h->n_pads; i++)
		put(r, "gamepad %s\n", h->pad[i]);
	put(r, "begin\n");
}

/* A tracker passes over what is no place in a picture; so does a reader, who has to refuse it. */
static bool is_somewhere(const struct bb_blob *b)
{
	return fabsf(b->x_px) <= 1e6F && fabsf(b->y_px) <= 1e6F && fabsf(b->area_px) <= 1e9F;
}

static void put_frame(struct bb_recorder *r, const struct bb_record_frame *f)
{
	size_t n = 0;

	for (size_t i = 0; i < f->n; i++)
		n += is_somewhere(&f->blobs[i]);
	put(r, "f %u %u %" PRId64 " %" PRId64 " %" PRId64 " %d %d %zu", f->camera, f->seq, f->device_ns,
	    f->arrived_ns, f->mid_ns, f->overflow, f->given, n);
	for (size_t i = 0; i < f->n; i++)
		if (is_somewhere(&f->blobs[i]))
			put(r, " %.9g %.9g %.9g", (double)f->blobs[i].x_px, (double)f->blobs[i].y_px,
			    (double)f->blobs[i].area_px);
	put(r, "\n");
	r->n_frames++;
}

static void put_pose(struct bb_recorder *r, const struct bb_record_pose *p)
{
	const struct bb_track_solution *s = &p->solution;

	put(r, "p %u %" PRId64 " %u %u %u", p->body, s->at_ns, s->flags, s->n_markers, s->n_cameras);
	put_vec(r, s->body.p);
	put_quat(r, s->body.q);
	put(r, " %.17g %.17g %.17g\n", s->position_sigma_mm, s->angle_sigma_deg, s->residual_px);
	r->n_poses++;
}

void bb_recorder_put(struct bb_recorder *r, const struct bb_record_item *item)
{
	if (item->kind == BB_RECORD_FRAME) {
		put_frame(r, &item->frame);
	} else if (item->kind == BB_RECORD_SOLVE) {
		put(r, "s %" PRId64 "\n", item->now_ns);
	} else if (item->kind == BB_RECORD_POSE) {
		put_pose(r, &item->pose);
	} else if (item->kind == BB_RECORD_PAD) {
		put(r, "g %u %" PRId64 " %u %u", item->pad.pad, item->pad.report.at_ns, item->pad.report.seq,
		    item->pad.report.buttons);
		for (size_t i = 0; i < BB_PAD_AXES; i++)
			put(r, " %.9g", (double)fminf(fmaxf(item->pad.report.axis[i], -1), 1)); /* of a NAN: -1 */
		put(r, "\n");
	}
}

/* ---- begin and end ---- */

enum bb_status bb_recorder_create(const char *path, const struct bb_record_head *head, struct bb_recorder **out,
                                  struct bb_error *err)
{
	struct bb_recorder *r = calloc(1, sizeof(*r));
	const size_t n = strlen(path);

	*out = NULL;
	if (!r)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "the recording");
	if (n > 4 && !strcmp(path + n - 4, ".zst")) {
		r->pack = ZSTD_createCStream();
		if (!r->pack || ZSTD_isError(ZSTD_CCtx_setParameter(r->pack, ZSTD_c_compressionLevel, PACK_LEVEL)) ||
		    ZSTD_isError(ZSTD_CCtx_setParameter(r->pack, ZSTD_c_checksumFlag, 1))) {
			bb_recorder_abort(r);
			return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "the recording");
		}
	}
	const enum bb_status status = bb_file_begin(&r->file, path, err);
	if (status != BB_OK) {
		bb_recorder_abort(r);
		return status;
	}
	put_head(r, head);
	*out = r;
	return BB_OK;
}

enum bb_status bb_recorder_commit(struct bb_recorder *r, struct bb_error *err)
{
	const struct bb_where where = { r->file.path, 0, 0 };
	enum bb_status status = BB_OK;

	put(r, "end %" PRIu64 " %" PRIu64 "\n", r->n_frames, r->n_poses);
	if (r->pack)
		pack(r, ZSTD_e_end);
	if (r->failed)
		status = bb_fail(err, BB_ERR_IO, 1901, &where, "the recording could not be written whole");
	else
		status = bb_file_commit(&r->file, err);
	bb_recorder_abort(r); /* what is left of it */
	return status;
}

void bb_recorder_abort(struct bb_recorder *r)
{
	if (!r)
		return;
	bb_file_abort(&r->file);
	ZSTD_freeCStream(r->pack);
	free(r);
}
