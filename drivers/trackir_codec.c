/* drivers/trackir_codec.c: see drivers/trackir_codec.h. Every byte that comes in is hostile. */
#include "drivers/trackir_codec.h"

#include <stdlib.h>
#include <string.h>

#define HEADER 4
#define TRAILER 4
#define WIDE_PX 1024 /* what 10 bits of column can say */

/* Commands */

struct trackir_command trackir_simple(uint8_t command)
{
	return (struct trackir_command){ { command }, 1 };
}

struct trackir_command trackir_video(bool on)
{
	return (struct trackir_command){ { TRACKIR_CMD_VIDEO, on ? 0 : 1 }, 2 };
}

struct trackir_command trackir_leds(uint8_t leds, uint8_t mask)
{
	return (struct trackir_command){ { TRACKIR_CMD_LEDS, leds, mask }, 3 };
}

struct trackir_command trackir_threshold(uint8_t threshold)
{
	return (struct trackir_command){ { TRACKIR_CMD_THRESHOLD, threshold, 1, 0 }, 4 };
}

struct trackir_command trackir_start_set(void)
{
	return (struct trackir_command){ { TRACKIR_CMD_SET, TRACKIR_SET_START, 0x10, 0x10, 0 }, 5 };
}

void trackir_exposure(uint32_t lines, struct trackir_command out[2])
{
	const uint8_t high = (uint8_t)(lines >> 8), low = (uint8_t)lines;

	out[0] = (struct trackir_command){
		{ TRACKIR_CMD_REGISTER, TRACKIR_REGISTER_SENSOR, TRACKIR_EXPOSURE_HIGH, high, 0, 0 }, 6
	};
	out[1] = (struct trackir_command){
		{ TRACKIR_CMD_REGISTER, TRACKIR_REGISTER_SENSOR, TRACKIR_EXPOSURE_LOW, low, 0, 0 }, 6
	};
}

struct trackir_command trackir_sync_offset(uint32_t offset_us)
{
	return (struct trackir_command){ { TRACKIR_CMD_SYNC_OFFSET, (uint8_t)(offset_us >> 24),
		                           (uint8_t)(offset_us >> 16), (uint8_t)(offset_us >> 8),
		                           (uint8_t)offset_us },
		                         5 };
}

uint16_t trackir_firmware_sum(const uint8_t *bytes, size_t n)
{
	uint32_t c = 0;

	for (size_t i = 0; i < n; i++) {
		c += bytes[i];
		c ^= (uint32_t)bytes[i] << 4;
	}
	return (uint16_t)c;
}

/* Packets */

static uint32_t be32(const uint8_t *p)
{
	return (uint32_t)p[0] << 24 | (uint32_t)p[1] << 16 | (uint32_t)p[2] << 8 | p[3];
}

static bool header_fits(const uint8_t *b, size_t n)
{
	return n >= HEADER && b[1] == TRACKIR_TYPE_PACKET && (b[0] ^ b[1] ^ b[2] ^ b[3]) == TRACKIR_XOR;
}

static bool is_whole(const uint8_t *b, size_t n)
{
	return n >= HEADER + TRAILER && header_fits(b, n) && be32(b + n - TRAILER) == n - HEADER - TRAILER;
}

static struct trackir_stripe stripe8(const uint8_t *b)
{
	const uint64_t bits = (uint64_t)be32(b) << 32 | be32(b + 4);

	return (struct trackir_stripe){ .first = (uint16_t)(bits >> 54),
		                        .line = (uint16_t)(bits >> 45 & 0x1FF),
		                        .points = (uint16_t)(bits >> 35 & 0x3FF),
		                        .sum_x = (uint32_t)(bits >> 15 & 0xFFFFF),
		                        .sum = (uint32_t)(bits & 0x7FFF) };
}

/* The short form has no sums: every point weighs the same. False: it ends before it begins. */
static bool stripe4(const uint8_t *b, struct trackir_stripe *out)
{
	const uint32_t line = b[0] | (b[3] & 0x20u) << 3;
	const uint32_t first = b[1] | (b[3] & 0x80u) << 1 | (b[3] & 0x10u) << 5;
	const uint32_t last = b[2] | (b[3] & 0x40u) << 2 | (b[3] & 0x08u) << 6;

	if (last < first)
		return false;
	const uint32_t points = last - first + 1;
	*out = (struct trackir_stripe){ .line = (uint16_t)line, .first = (uint16_t)first, .points = (uint16_t)points,
		                        .sum = points, .sum_x = points * (points - 1) / 2 };
	return true;
}

/* A long stripe must lie on the sensor, weigh something, and have its centre inside itself. */
static bool plausible(const struct trackir_stripe *s)
{
	return s->points && s->sum && s->first + s->points <= WIDE_PX &&
	       s->sum_x <= (uint64_t)s->sum * (s->points - 1u);
}

/* In scan order and apart, which also bounds how many there can be on one line. */
static bool follows(const struct trackir_stripe *a, const struct trackir_stripe *b)
{
	return b->line > a->line || (b->line == a->line && b->first >= a->first + a->points);
}

static bool read_stripes(const uint8_t *b, size_t n, bool lengthy, struct trackir_packet *out)
{
	const size_t step = lengthy ? 8 : 4;
	struct trackir_stripe s;

	if (n % step)
		return false;
	for (size_t i = 0; i < n; i += step) {
		if (!be32(b + i))
			break; /* an all-zero stripe ends the list */
		if (lengthy)
			s = stripe8(b + i);
		else if (!stripe4(b + i, &s))
			return false;
		if (!plausible(&s) || (out->n && !follows(&out->stripe[out->n - 1], &s)))
			return false;
		out->stripe[out->n++] = s;
	}
	return true;
}

bool trackir_packet_read(const uint8_t *bytes, size_t n, struct trackir_packet *out)
{
	size_t at = HEADER;

	out->n = 0;
	if (n > TRACKIR_READ_BYTES || !is_whole(bytes, n))
		return false;
	out->number = bytes[0];
	out->kind = bytes[2];
	out->stamped = out->kind == TRACKIR_KIND_STAMPED;
	if (out->kind != TRACKIR_KIND_SHORT && out->kind != TRACKIR_KIND_LONG && !out->stamped)
		return false;
	if (out->stamped) {
		if (n < HEADER + TRACKIR_STAMP_BYTES + TRAILER)
			return false;
		out->counter = be32(bytes + at);
		out->mid_us = be32(bytes + at + 4);
		out->usb_frame = (uint16_t)(bytes[at + 8] << 8 | bytes[at + 9]);
		at += TRACKIR_STAMP_BYTES;
	}
	return read_stripes(bytes + at, n - TRAILER - at, out->kind != TRACKIR_KIND_SHORT, out);
}

bool trackir_packet4_read(const uint8_t *bytes, size_t n, struct trackir_packet *out)
{
	out->n = 0;
	if (n < 2 || bytes[1] != TRACKIR_TYPE_STRIPES4 || bytes[0] > 0x3E || bytes[0] < 2 || bytes[0] > n)
		return false;
	out->kind = TRACKIR_KIND_SHORT;
	out->stamped = false;
	for (size_t i = 2; i + 4 <= bytes[0]; i += 4)
		if (be32(bytes + i) && stripe4(bytes + i, &out->stripe[out->n]))
			out->n++;
	return true;
}

/* Reassembly */

void trackir_stream_init(struct trackir_stream *s)
{
	s->n = s->packet.n = 0; /* the buffers themselves need no clearing */
	s->n_partial = s->n_bad = 0;
	s->status = (struct trackir_status){ 0 };
	s->config = 0;
}

static enum trackir_item reply(struct trackir_stream *s, const uint8_t *b, size_t n)
{
	if (n >= 7 && b[0] == 0x07 && b[1] == TRACKIR_TYPE_STATUS) {
		s->status = (struct trackir_status){ .firmware_loaded = b[3] == 1,
			                             .firmware_sum = (uint16_t)(b[4] << 8 | b[5]),
			                             .config_flag = b[6] };
		return TRACKIR_STATUS;
	}
	if (n >= 2 && b[1] == TRACKIR_TYPE_CONFIG) {
		s->config = b[0];
		return TRACKIR_CONFIG;
	}
	return TRACKIR_NOTHING;
}

static enum trackir_item whole(struct trackir_stream *s, const uint8_t *bytes, size_t n)
{
	const bool fits = trackir_packet_read(bytes, n, &s->packet);

	s->n = 0;
	s->n_bad += !fits;
	return fits ? TRACKIR_FRAME : TRACKIR_NOTHING;
}

static void drop_partial(struct trackir_stream *s)
{
	s->n_partial += s->n > 0;
	s->n = 0;
}

enum trackir_item trackir_stream_add(struct trackir_stream *s, const uint8_t *bytes, size_t n)
{
	if (!n || n > sizeof(s->bytes))
		return TRACKIR_NOTHING;
	/* A packet's length stands at its end only, so the end of one is where the length fits. A transfer that begins
	 * like a packet begins one: what was waiting for its end has lost it. */
	if (header_fits(bytes, n))
		drop_partial(s);
	if (is_whole(bytes, n))
		return whole(s, bytes, n);
	if (!s->n && !header_fits(bytes, n)) {
		const enum trackir_item item = reply(s, bytes, n);
		s->n_bad += item == TRACKIR_NOTHING;
		return item;
	}
	if (s->n + n > sizeof(s->bytes)) {
		drop_partial(s);
		return TRACKIR_NOTHING;
	}
	memcpy(s->bytes + s->n, bytes, n);
	s->n += n;
	return is_whole(s->bytes, s->n) ? whole(s, s->bytes, s->n) : TRACKIR_NOTHING;
}

/* Blobs */

struct group {
	uint64_t sum, sum_x, sum_y;
	uint32_t points;
};

static uint16_t root(uint16_t *parent, uint16_t i)
{
	while (parent[i] != i) {
		parent[i] = parent[parent[i]];
		i = parent[i];
	}
	return i;
}

static void join(uint16_t *parent, uint16_t a, uint16_t b)
{
	a = root(parent, a);
	b = root(parent, b);
	if (a < b)
		parent[b] = a;
	else
		parent[a] = b;
}

static bool touch(const struct trackir_stripe *a, const struct trackir_stripe *b)
{
	return a->first < b->first + b->points && b->first < a->first + a->points;
}

static void label(const struct trackir_packet *p, uint16_t *parent)
{
	size_t above = 0, above_end = 0, line_start = 0; /* [above, above_end): the line before this one */

	for (size_t i = 0; i < p->n; i++) {
		const uint32_t line = p->stripe[i].line;
		parent[i] = (uint16_t)i;
		if (i && line != p->stripe[i - 1].line) {
			above = line_start;
			above_end = i;
			line_start = i;
		}
		for (size_t k = above; k < above_end; k++)
			if (p->stripe[k].line + 1u == line && touch(&p->stripe[k], &p->stripe[i]))
				join(parent, (uint16_t)k, (uint16_t)i);
	}
}

static int by_place(const void *a, const void *b)
{
	const struct bb_blob *p = a, *q = b;

	if (p->y_px != q->y_px)
		return p->y_px < q->y_px ? -1 : 1;
	return p->x_px < q->x_px ? -1 : p->x_px > q->x_px;
}

static void gather(const struct trackir_packet *p, uint16_t *parent, struct group *group)
{
	for (size_t i = 0; i < p->n; i++) {
		const struct trackir_stripe *s = &p->stripe[i];
		struct group *g = &group[root(parent, (uint16_t)i)];
		g->sum += s->sum;
		g->sum_x += (uint64_t)s->first * s->sum + s->sum_x;
		g->sum_y += (uint64_t)s->line * s->sum;
		g->points += s->points;
	}
}

size_t trackir_blobs(const struct trackir_packet *packet, struct bb_blob *blobs, size_t cap, bool *overflow)
{
	uint16_t parent[TRACKIR_STRIPES_MAX];
	struct group group[TRACKIR_STRIPES_MAX];
	size_t n = 0;

	*overflow = false;
	memset(group, 0, packet->n * sizeof(*group));
	label(packet, parent);
	gather(packet, parent, group);
	for (size_t i = 0; i < packet->n; i++) {
		const struct group *g = &group[i];
		if (!g->sum)
			continue;
		if (n == cap) {
			*overflow = true;
			break;
		}
		blobs[n++] = (struct bb_blob){ (float)((double)g->sum_x / (double)g->sum),
			                       (float)((double)g->sum_y / (double)g->sum), (float)g->points };
	}
	if (n)
		qsort(blobs, n, sizeof(*blobs), by_place);
	return n;
}
