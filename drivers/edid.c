/* drivers/edid.c: see drivers/edid.h; VESA E-EDID A.2, CTA-861. */
#include "drivers/edid.h"

#include "drivers/ddcci_wire.h"

#include <string.h>

#define TAG_CTA 0x02
#define TAG_DISPLAYID 0x70
#define DESCRIPTOR_BYTES 18

static const uint8_t header[8] = { 0x00, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0x00 };

static bool sum_is_good(const uint8_t *block)
{
#ifdef BB_FUZZ
	(void)block;
	return true;
#else
	unsigned int sum = 0;

	for (size_t i = 0; i < EDID_BLOCK_BYTES; i++)
		sum += block[i];
	return sum % 256 == 0;
#endif
}

int edid_bad_block(const uint8_t *bytes, size_t n)
{
	if (n < EDID_BLOCK_BYTES || memcmp(bytes, header, sizeof(header)))
		return 0;
	for (size_t at = 0; at < n; at += EDID_BLOCK_BYTES)
		if (n - at < EDID_BLOCK_BYTES || !sum_is_good(bytes + at))
			return (int)(at / EDID_BLOCK_BYTES);
	return -1;
}

double edid_timing_hz(const struct edid_timing *t)
{
	const double pixels = (double)(t->width + t->h_blank) * (t->height + t->v_blank);

	return pixels > 0 ? t->clock_khz * 1e3 / pixels : 0;
}

/* ---- detailed timings ---- */

static enum edid_stereo stereo_of(uint8_t flags)
{
	const bool one = flags & 1;

	switch (flags >> 5 & 3) {
	case 1:
		return one ? EDID_STEREO_ROWS_RIGHT_EVEN : EDID_STEREO_SEQUENTIAL_RIGHT;
	case 2:
		return one ? EDID_STEREO_ROWS_LEFT_EVEN : EDID_STEREO_SEQUENTIAL_LEFT;
	case 3:
		return one ? EDID_STEREO_SIDE_BY_SIDE : EDID_STEREO_FOUR_WAY;
	default:
		return EDID_STEREO_NONE;
	}
}

static uint16_t join(unsigned int high, unsigned int low, unsigned int low_bits)
{
	return (uint16_t)(high << low_bits | low);
}

/* False: the descriptor is not a timing. */
static bool take_timing(const uint8_t *d, struct edid_timing *t)
{
	if (!d[0] && !d[1])
		return false;
	*t = (struct edid_timing){
		.clock_khz = (d[0] | d[1] << 8) * 10,
		.width = join(d[4] >> 4u, d[2], 8),
		.h_blank = join(d[4] & 15u, d[3], 8),
		.height = join(d[7] >> 4u, d[5], 8),
		.v_blank = join(d[7] & 15u, d[6], 8),
		.h_front = join(d[11] >> 6u & 3u, d[8], 8),
		.h_sync = join(d[11] >> 4u & 3u, d[9], 8),
		.v_front = join(d[11] >> 2u & 3u, d[10] >> 4u, 4),
		.v_sync = join(d[11] & 3u, d[10] & 15u, 4),
		.width_mm = join(d[14] >> 4u, d[12], 8),
		.height_mm = join(d[14] & 15u, d[13], 8),
		.interlaced = d[17] & 0x80,
		.stereo = stereo_of(d[17]),
	};
	return true;
}

static void add_timing(struct edid_info *e, const uint8_t *d)
{
	if (e->n_timings < EDID_MOST_TIMINGS && take_timing(d, &e->timing[e->n_timings]))
		e->n_timings++;
}

/* ---- the base block ---- */

/* 13 bytes of text, ended by a line feed; only what can be shown. Blanks at the end are filling. */
static void take_text(const uint8_t *d, char out[14])
{
	size_t n = 0;

	while (n < 13 && d[5 + n] >= 0x20 && d[5 + n] < 0x7F) {
		out[n] = (char)d[5 + n];
		n++;
	}
	while (n && out[n - 1] == ' ')
		n--;
	out[n] = '\0';
}

static void take_range(const uint8_t *d, struct edid_info *e)
{
	const unsigned int more = d[4]; /* 1.4: offsets of 255 for rates that do not fit a byte */

	e->has_range = true;
	e->least_hz = (uint16_t)(d[5] + ((more & 3) == 3 ? 255 : 0));
	e->most_hz = (uint16_t)(d[6] + (more & 2 ? 255 : 0));
	e->least_khz = (uint16_t)(d[7] + ((more >> 2 & 3) == 3 ? 255 : 0));
	e->most_khz = (uint16_t)(d[8] + (more & 8 ? 255 : 0));
	e->most_mhz = (uint16_t)(d[9] * 10);
}

static void take_descriptor(const uint8_t *d, struct edid_info *e)
{
	if (d[0] || d[1]) {
		add_timing(e, d);
		return;
	}
	switch (d[3]) {
	case 0xFC:
		take_text(d, e->name);
		break;
	case 0xFE:
		take_text(d, e->text);
		break;
	case 0xFF:
		take_text(d, e->serial_text);
		break;
	case 0xFD:
		take_range(d, e);
		break;
	default:
		break;
	}
}

static char letter(unsigned int five_bits)
{
	return five_bits >= 1 && five_bits <= 26 ? (char)('@' + five_bits) : '?';
}

static void take_identity(const uint8_t *b, struct edid_info *e)
{
	const unsigned int maker = (unsigned int)(b[8] << 8 | b[9]);

	for (unsigned int i = 0; i < 3; i++)
		e->maker[i] = letter(maker >> (10 - 5 * i) & 31);
	e->product = (uint16_t)(b[10] | b[11] << 8);
	for (unsigned int i = 0; i < 4; i++)
		e->serial |= (uint32_t)b[12 + i] << (8 * i);
	e->week = b[16];
	e->year = (uint16_t)(1990 + b[17]);
	e->version = b[18];
	e->revision = b[19];
}

static void take_picture(const uint8_t *b, struct edid_info *e)
{
	static const uint8_t bits[8] = { 0, 6, 8, 10, 12, 14, 16, 0 };

	e->digital = b[20] & 0x80;
	if (e->digital && e->version == 1 && e->revision >= 4) {
		e->bits_per_color = bits[b[20] >> 4 & 7];
		e->interface = b[20] & 15;
	}
	e->width_cm = b[21];
	e->height_cm = b[22];
	e->gamma_x100 = b[23] == 0xFF ? 0 : (uint16_t)(100 + b[23]);
	/* Ten bits each: the high eight in a byte of their own, the low pairs packed before them. */
	for (unsigned int i = 0; i < 8; i++)
		e->chroma[i] = (uint16_t)(b[27 + i] << 2 | (b[25 + i / 4] >> (6 - 2 * (i % 4)) & 3));
}

/* ---- extensions ---- */

/* Data blocks fill 4..first timing; a length that runs out of the collection ends the walk. */
static void walk_cta(const uint8_t *b, struct edid_info *e, struct edid_extension *x)
{
	const size_t timings = b[2];

	if (timings < 4 || timings > EDID_BLOCK_BYTES - 1)
		return; /* 0: nothing in it; anything else is damage */
	for (size_t at = 4; x->revision >= 3 && at < timings;) {
		const size_t next = at + 1 + (b[at] & 31u);
		if (next > timings)
			break;
		x->n_blocks++;
		at = next;
	}
	for (size_t at = timings; at + DESCRIPTOR_BYTES <= EDID_BLOCK_BYTES - 1 && (b[at] || b[at + 1]);
	     at += DESCRIPTOR_BYTES)
		add_timing(e, b + at);
}

/* A DisplayID section inside an EDID block: version, length, type, count, then blocks of tag, revision, length. */
static void walk_displayid(const uint8_t *b, struct edid_extension *x)
{
	const size_t n = b[2], end = n > 121 ? 5 + 121 : 5 + n;

	for (size_t at = 5; at + 3 <= end;) {
		const size_t next = at + 3 + b[at + 2];
		if (next > end || (!b[at] && !b[at + 2]))
			break;
		x->n_blocks++;
		at = next;
	}
}

static void take_extension(const uint8_t *b, struct edid_info *e)
{
	struct edid_extension *x = &e->extension[e->n_extensions++];

	*x = (struct edid_extension){ .tag = b[0], .revision = b[1], .good = sum_is_good(b) };
	if (!x->good)
		return;
	if (x->tag == TAG_CTA)
		walk_cta(b, e, x);
	else if (x->tag == TAG_DISPLAYID)
		walk_displayid(b, x);
}

enum bb_status edid_parse(const uint8_t *bytes, size_t n, struct edid_info *out)
{
	memset(out, 0, sizeof(*out));
	if (n < EDID_BLOCK_BYTES || memcmp(bytes, header, sizeof(header)) || !sum_is_good(bytes))
		return BB_ERR_FORMAT;
	take_identity(bytes, out);
	take_picture(bytes, out);
	for (size_t at = 54; at < 126; at += DESCRIPTOR_BYTES)
		take_descriptor(bytes + at, out);
	out->n_declared = bytes[126];
	for (size_t i = 1; i <= out->n_declared && i < EDID_MOST_BLOCKS && (i + 1) * EDID_BLOCK_BYTES <= n; i++)
		take_extension(bytes + i * EDID_BLOCK_BYTES, out);
	return BB_OK;
}
