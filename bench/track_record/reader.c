/* bench/track_record/reader.c: lines out of a file that anybody may have written, see record.h. */
#define _GNU_SOURCE /* O_CLOEXEC */
#include "bench/track_record/record.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zstd.h>

#define IN_BYTES 65536
#define WINDOW_LOG_MOST 23 /* 8 MiB: a file may not ask for more memory than that */
#define STAMP_MOST (INT64_MAX / 4)
#define FAR_M 1e6

struct bb_record_reader {
	char path[BB_PATH_MAX_BYTES];
	int fd;                  /* -1: bytes from memory */
	const uint8_t *memory;
	size_t n_memory;
	ZSTD_DStream *unpack;
	bool packed, ended;      /* ended: by its own last line */
	bool held;               /* there may be more text in the unpacker than was room for */
	ZSTD_inBuffer in;        /* what of raw is not used yet */
	size_t n_text, at_text;
	size_t unfinished;       /* 0: the compressed bytes are whole, their checksum too */
	uint64_t n_frames, n_poses;
	int line_no;
	struct bb_record_head head;
	struct bb_blob blobs[BB_CAMERA_BLOBS_MAX];
	char line[BB_RECORD_LINE];
	uint8_t raw[IN_BYTES], text[IN_BYTES];
};

static enum bb_status bad(const struct bb_record_reader *r, struct bb_error *err, const char *what)
{
	const struct bb_where where = { r->path, r->line_no, 0 };

	return bb_fail(err, BB_ERR_FORMAT, 1762, &where, "%s", what);
}

/* ---- bytes ---- */

/* More raw bytes; false: there are none. */
static bool fetch(struct bb_record_reader *r)
{
	ssize_t n = 0;

	if (r->fd < 0) {
		n = (ssize_t)(r->n_memory < IN_BYTES ? r->n_memory : IN_BYTES);
		if (n)
			memcpy(r->raw, r->memory, (size_t)n);
		r->memory += n;
		r->n_memory -= (size_t)n;
	} else {
		do
			n = read(r->fd, r->raw, IN_BYTES);
		while (n < 0 && errno == EINTR);
	}
	r->in = (ZSTD_inBuffer){ r->raw, n > 0 ? (size_t)n : 0, 0 };
	return n > 0;
}

/* More text; BB_SKIPPED: there is none. */
static enum bb_status refill(struct bb_record_reader *r, struct bb_error *err)
{
	ZSTD_outBuffer out = { r->text, IN_BYTES, 0 };

	r->at_text = r->n_text = 0;
	while (!out.pos) {
		if (r->in.pos == r->in.size && !r->held && !fetch(r))
			return BB_SKIPPED;
		if (!r->packed) {
			memcpy(r->text, (const uint8_t *)r->in.src + r->in.pos, r->in.size - r->in.pos);
			out.pos = r->in.size - r->in.pos;
			r->in.pos = r->in.size;
		} else {
			r->unfinished = ZSTD_decompressStream(r->unpack, &out, &r->in);
			if (ZSTD_isError(r->unfinished))
				return bad(r, err, "the compressed bytes are damaged");
			r->held = r->unfinished && out.pos == out.size;
		}
	}
	r->n_text = out.pos;
	return BB_OK;
}

/* A line without its end; BB_SKIPPED: the file is over, BB_TIMEOUT: in the middle of one. */
static enum bb_status next_line(struct bb_record_reader *r, struct bb_error *err)
{
	size_t n = 0;

	for (;;) {
		if (r->at_text == r->n_text) {
			const enum bb_status status = refill(r, err);
			if (status != BB_OK)
				return status == BB_SKIPPED && n ? BB_TIMEOUT : status;
		}
		const size_t left = r->n_text - r->at_text;
		const uint8_t *from = r->text + r->at_text, *end = memchr(from, '\n', left);
		const size_t piece = end ? (size_t)(end - from) : left;
		if (piece >= sizeof(r->line) - n || memchr(from, 0, piece)) {
			r->line_no++;
			return bad(r, err, "a line too long, or with a zero in it");
		}
		memcpy(r->line + n, from, piece);
		n += piece;
		r->at_text += piece + (end != NULL);
		if (!end)
			continue;
		r->line[n] = '\0';
		r->line_no++;
		return BB_OK;
	}
}

/* ---- words ---- */

/* The next word of a line, cut off; "" when there is none, or two spaces stood together. */
static char *word(char **rest)
{
	char *begin = *rest, *space = strchr(begin, ' ');

	if (space)
		*space = '\0';
	*rest = space ? space + 1 : begin + strlen(begin);
	return begin;
}

static bool whole(char **rest, int64_t least, int64_t most, int64_t *out)
{
	const char *text = word(rest);
	char *end;

	if (!*text || strspn(text, "-0123456789") != strlen(text))
		return false;
	errno = 0;
	*out = strtoll(text, &end, 10);
	return !*end && !errno && *out >= least && *out <= most;
}

static bool number(char **rest, double most, double *out)
{
	const char *text = word(rest);
	char *end;

	if (!*text || strspn(text, "+-.0123456789eE") != strlen(text)) /* no hexadecimal, no words */
		return false;
	*out = strtod(text, &end);
	return !*end && isfinite(*out) && fabs(*out) <= most;
}

/* As the float it was: nine digits name it, and it is the nearest one to them. */
static bool single(char **rest, float most, float *out)
{
	const char *text = word(rest);
	char *end;

	if (!*text || strspn(text, "+-.0123456789eE") != strlen(text))
		return false;
	*out = strtof(text, &end);
	return !*end && isfinite(*out) && fabsf(*out) <= most;
}

static bool vec(char **rest, struct bb_vec3 *v)
{
	return number(rest, FAR_M, &v->x) && number(rest, FAR_M, &v->y) && number(rest, FAR_M, &v->z);
}

static bool quat(char **rest, struct bb_quat *q)
{
	const bool all = number(rest, 2, &q->x) && number(rest, 2, &q->y) && number(rest, 2, &q->z) && number(rest, 2, &q->w);

	return all && fabs(q->x * q->x + q->y * q->y + q->z * q->z + q->w * q->w - 1) < 1e-3;
}

static bool name(char **rest, char out[BB_ID_MAX])
{
	const char *text = word(rest);
	const size_t n = strlen(text);

	for (size_t i = 0; i < n; i++)
		if (text[i] < ' ' || text[i] > 126)
			return false;
	if (!n || n >= BB_ID_MAX)
		return false;
	memcpy(out, text, n + 1);
	return true;
}

/* ---- the head ---- */

static bool take_room(struct bb_record_head *h, char *rest)
{
	char id[BB_ID_MAX];

	if (h->sha256[0] || !name(&rest, id))
		return false;
	const char *sum = word(&rest);
	const size_t n = strlen(sum);
	if (strcmp(sum, "-") != 0 && (n != 64 || strspn(sum, "0123456789abcdef") != n))
		return false;
	memcpy(h->room, id, sizeof(id));
	memcpy(h->sha256, sum, n + 1);
	return !*rest;
}

static bool take_tracker(struct bb_record_head *h, char *rest)
{
	const bool all = !h->has_tracker && number(&rest, 100, &h->sigma_px) && whole(&rest, 0, STAMP_MOST, &h->group_ns) &&
	                 whole(&rest, 0, STAMP_MOST, &h->freeze_ns) && vec(&rest, &h->room_min) &&
	                 vec(&rest, &h->room_max) && vec(&rest, &h->neutral.p) && quat(&rest, &h->neutral.q);

	h->has_tracker = true;
	return all && !*rest;
}

static bool take_body(struct bb_record_head *h, char *rest)
{
	struct bb_body *b = &h->body[h->n_bodies];
	int64_t n = 0;

	if (h->n_bodies == BB_BODIES_MAX)
		return false;
	memset(b, 0, sizeof(*b));
	if (!name(&rest, b->id) || !whole(&rest, 0, BB_ARRAY_LEN(b->marker), &n))
		return false;
	for (int64_t i = 0; i < n; i++)
		if (!vec(&rest, &b->marker[i]))
			return false;
	b->n_markers = (size_t)n;
	h->n_bodies++;
	return vec(&rest, &b->eye_centre) && !*rest;
}

static bool take_name(char list[][BB_ID_MAX], size_t *n, size_t most, char *rest)
{
	return *n < most && name(&rest, list[(*n)++]) && !*rest;
}

/* begin: the line was "begin". */
static bool take_head_line(struct bb_record_head *h, char *rest, bool *begin)
{
	const char *key = word(&rest);

	*begin = !strcmp(key, "begin") && h->sha256[0] && !*rest;
	if (!strcmp(key, "room"))
		return take_room(h, rest);
	if (!strcmp(key, "tracker"))
		return take_tracker(h, rest);
	if (!strcmp(key, "camera"))
		return take_name(h->camera, &h->n_cameras, BB_RECORD_CAMERAS_MAX, rest);
	if (!strcmp(key, "body"))
		return take_body(h, rest);
	if (!strcmp(key, "gamepad"))
		return take_name(h->pad, &h->n_pads, BB_RECORD_PADS_MAX, rest);
	return *begin;
}

static enum bb_status over(const struct bb_record_reader *r, struct bb_error *err)
{
	const struct bb_where where = { r->path, r->line_no, 0 };

	return bb_fail(err, BB_ERR_FORMAT, 1763, &where, "after %" PRIu64 " camera frames and %" PRIu64 " poses", r->n_frames,
	               r->n_poses);
}

static enum bb_status read_head(struct bb_record_reader *r, struct bb_error *err)
{
	bool begin = false;

	while (!begin) {
		const enum bb_status status = next_line(r, err);
		if (status > 0)
			return r->line_no || r->packed ? over(r, err) : bad(r, err, "there is not one line in it");
		if (status != BB_OK)
			return status;
		if (r->line_no == 1) {
			if (strcmp(r->line, "blackburst-track 1") != 0)
				return bad(r, err, "its first line is not 'blackburst-track 1'");
		} else if (!take_head_line(&r->head, r->line, &begin)) {
			return bad(r, err, "a line of the head that cannot be");
		}
	}
	return BB_OK;
}

/* ---- items ---- */

static bool take_frame(struct bb_record_reader *r, char *rest, struct bb_record_item *item)
{
	struct bb_record_frame *f = &item->frame;
	int64_t camera, seq, overflow, given, n;

	if (!whole(&rest, 0, (int64_t)r->head.n_cameras - 1, &camera) || !whole(&rest, 0, UINT32_MAX, &seq) ||
	    !whole(&rest, -STAMP_MOST, STAMP_MOST, &f->device_ns) || !whole(&rest, -STAMP_MOST, STAMP_MOST, &f->arrived_ns) ||
	    !whole(&rest, -STAMP_MOST, STAMP_MOST, &f->mid_ns) || !whole(&rest, 0, 1, &overflow) ||
	    !whole(&rest, 0, 1, &given) || !whole(&rest, 0, BB_CAMERA_BLOBS_MAX, &n))
		return false;
	for (int64_t i = 0; i < n; i++) {
		struct bb_blob *b = &r->blobs[i];
		if (!single(&rest, 1e6F, &b->x_px) || !single(&rest, 1e6F, &b->y_px) || !single(&rest, 1e9F, &b->area_px))
			return false;
	}
	item->kind = BB_RECORD_FRAME;
	f->camera = (uint16_t)camera;
	f->seq = (uint32_t)seq;
	f->overflow = overflow;
	f->given = given;
	f->n = (size_t)n;
	f->blobs = r->blobs;
	r->n_frames++;
	return !*rest;
}

static bool take_pose(struct bb_record_reader *r, char *rest, struct bb_record_item *item)
{
	struct bb_track_solution *s = &item->pose.solution;
	int64_t body, flags, n_markers, n_cameras;

	memset(s, 0, sizeof(*s));
	if (!whole(&rest, 0, (int64_t)r->head.n_bodies - 1, &body) || !whole(&rest, -STAMP_MOST, STAMP_MOST, &s->at_ns) ||
	    !whole(&rest, 0, 0xffff, &flags) || !whole(&rest, 0, 0xffff, &n_markers) || !whole(&rest, 0, 0xffff, &n_cameras) ||
	    !vec(&rest, &s->body.p) || !quat(&rest, &s->body.q) || !number(&rest, 1e300, &s->position_sigma_mm) ||
	    !number(&rest, 1e300, &s->angle_sigma_deg) || !number(&rest, 1e300, &s->residual_px))
		return false;
	item->kind = BB_RECORD_POSE;
	item->pose.body = (uint16_t)body;
	s->flags = (unsigned)flags;
	s->n_markers = (uint16_t)n_markers;
	s->n_cameras = (uint16_t)n_cameras;
	r->n_poses++;
	return !*rest;
}

static bool take_pad(struct bb_record_reader *r, char *rest, struct bb_record_item *item)
{
	struct bb_pad_report *p = &item->pad.report;
	int64_t pad, seq, buttons;

	if (!whole(&rest, 0, (int64_t)r->head.n_pads - 1, &pad) || !whole(&rest, -STAMP_MOST, STAMP_MOST, &p->at_ns) ||
	    !whole(&rest, 0, UINT32_MAX, &seq) || !whole(&rest, 0, UINT32_MAX, &buttons))
		return false;
	for (size_t i = 0; i < BB_PAD_AXES; i++)
		if (!single(&rest, 1.0F, &p->axis[i]))
			return false;
	item->kind = BB_RECORD_PAD;
	item->pad.pad = (uint16_t)pad;
	p->seq = (uint32_t)seq;
	p->buttons = (uint32_t)buttons;
	p->battery = NAN;
	return !*rest;
}

static bool take_end(struct bb_record_reader *r, char *rest, struct bb_record_item *item)
{
	int64_t n_frames, n_poses;

	if (!whole(&rest, 0, INT64_MAX, &n_frames) || !whole(&rest, 0, INT64_MAX, &n_poses) || *rest)
		return false;
	item->kind = BB_RECORD_END;
	r->ended = true;
	return (uint64_t)n_frames == r->n_frames && (uint64_t)n_poses == r->n_poses;
}

static bool take_item(struct bb_record_reader *r, char *rest, struct bb_record_item *item)
{
	const char *key = word(&rest);

	if (!strcmp(key, "f"))
		return take_frame(r, rest, item);
	if (!strcmp(key, "p"))
		return take_pose(r, rest, item);
	if (!strcmp(key, "g"))
		return take_pad(r, rest, item);
	if (!strcmp(key, "end"))
		return take_end(r, rest, item);
	item->kind = BB_RECORD_SOLVE;
	return !strcmp(key, "s") && whole(&rest, -STAMP_MOST, STAMP_MOST, &item->now_ns) && !*rest;
}

/* Nothing may follow the end, not even in another compressed part. */
static enum bb_status nothing_more(struct bb_record_reader *r, struct bb_error *err)
{
	if (r->at_text == r->n_text) {
		const enum bb_status status = refill(r, err);
		if (status == BB_SKIPPED)
			return r->unfinished ? over(r, err) : BB_OK;
		if (status != BB_OK)
			return status;
	}
	return bad(r, err, "something follows its end");
}

enum bb_status bb_record_next(struct bb_record_reader *r, struct bb_record_item *item, struct bb_error *err)
{
	if (r->ended) {
		item->kind = BB_RECORD_END;
		return BB_OK;
	}
	const enum bb_status status = next_line(r, err);
	if (status > 0)
		return over(r, err);
	if (status != BB_OK)
		return status;
	if (!take_item(r, r->line, item))
		return bad(r, err, r->ended ? "its end counts other frames or poses than came" : "a line that cannot be");
	return r->ended ? nothing_more(r, err) : BB_OK;
}

/* ---- begin and end ---- */

const struct bb_record_head *bb_record_head(const struct bb_record_reader *r)
{
	return &r->head;
}

void bb_record_close(struct bb_record_reader *r)
{
	if (!r)
		return;
	if (r->fd >= 0)
		close(r->fd);
	ZSTD_freeDStream(r->unpack);
	free(r);
}

static struct bb_record_reader *make(void)
{
	struct bb_record_reader *r = calloc(1, sizeof(*r));

	if (!r)
		return NULL;
	r->fd = -1;
	r->unpack = ZSTD_createDStream();
	if (!r->unpack || ZSTD_isError(ZSTD_DCtx_setParameter(r->unpack, ZSTD_d_windowLogMax, WINDOW_LOG_MOST))) {
		bb_record_close(r);
		return NULL;
	}
	return r;
}

/* The first bytes say whether it is compressed. */
static enum bb_status begin(struct bb_record_reader *r, struct bb_error *err)
{
	static const uint8_t magic[4] = { 0x28, 0xB5, 0x2F, 0xFD };

	if (!fetch(r))
		return bad(r, err, "there is nothing in it");
	r->packed = r->in.size >= sizeof(magic) && !memcmp(r->raw, magic, sizeof(magic));
	return read_head(r, err);
}

enum bb_status bb_record_open_bytes(const uint8_t *bytes, size_t n, struct bb_record_reader **reader, struct bb_error *err)
{
	struct bb_record_reader *r = *reader ? *reader : make();

	if (!r)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "the recording");
	*reader = r;
	snprintf(r->path, sizeof(r->path), "memory");
	r->memory = bytes;
	r->n_memory = n;
	r->packed = r->held = r->ended = false;
	r->n_text = r->at_text = r->unfinished = 0;
	r->n_frames = r->n_poses = 0;
	r->line_no = 0;
	memset(&r->head, 0, offsetof(struct bb_record_head, camera));
	(void)ZSTD_DCtx_reset(r->unpack, ZSTD_reset_session_only);
	return begin(r, err);
}

enum bb_status bb_record_open(const char *path, struct bb_record_reader **out, struct bb_error *err)
{
	const struct bb_where where = { path, 0, 0 };
	struct bb_record_reader *r = make();
	struct stat st;

	*out = NULL;
	if (!r)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "the recording");
	snprintf(r->path, sizeof(r->path), "%s", path);
	r->fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
	enum bb_status status = BB_OK;
	if (r->fd < 0)
		status = bb_fail(err, BB_ERR_IO, 1001, &where, "%s", strerror(errno));
	else if (fstat(r->fd, &st) || !S_ISREG(st.st_mode))
		status = bb_fail(err, BB_ERR_IO, 1001, &where, "not a regular file");
	else
		status = begin(r, err);
	if (status == BB_OK)
		*out = r;
	else
		bb_record_close(r);
	return status;
}
