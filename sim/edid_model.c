/* sim/edid_model.c: the table of models and the bytes of their EDIDs; see VESA E-EDID A.2 and CVT 1.2. */
#include "sim/edid_model.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#define SRGB { { 0.640, 0.330 }, { 0.300, 0.600 }, { 0.150, 0.060 }, { 0.3125, 0.3291 } }
#define DIGITAL_8BIT_DP 0xA5

static const struct sim_edid_model models[] = {
	/* The Reality Deck's monitor: identity and primaries as real ones report them. */
	{ "S27A850D", "SMS27A850", "SAM", 0x083C, 2560, 1440, 60, 518, 324, DIGITAL_8BIT_DP, true, 2013, 300,
	  { { 0.6503, 0.3369 }, { 0.2958, 0.6044 }, { 0.1474, 0.0742 }, { 0.3125, 0.3291 } } },
	/* Ours, maker "BBT": a node's operator screen, and one that can do 120 Hz stereo. */
	{ "desk24", "BBURST-24", "BBT", 0x0018, 1920, 1200, 60, 518, 324, DIGITAL_8BIT_DP, true, 2024, 300, SRGB },
	{ "stereo27", "BBURST-3D", "BBT", 0x003D, 1920, 1080, 120, 598, 336, DIGITAL_8BIT_DP, false, 2024, 250, SRGB },
	{ "generic", "BBURST-SIM", "BBT", 0x0001, 1920, 1080, 60, 531, 299, DIGITAL_8BIT_DP, false, 2024, 250, SRGB },
};

const struct sim_edid_model *sim_edid_model_at(size_t i)
{
	return i < BB_ARRAY_LEN(models) ? &models[i] : NULL;
}

const struct sim_edid_model *sim_edid_model(const char *name)
{
	for (size_t i = 0; name && i < BB_ARRAY_LEN(models); i++)
		if (!strcmp(models[i].name, name))
			return &models[i];
	return &models[BB_ARRAY_LEN(models) - 1];
}

static void put_dtd(uint8_t d[18], const struct bb_cvt *t, const struct sim_edid_spec *spec)
{
	const int w_mm = spec->model->width_mm, h_mm = spec->model->height_mm;
	const int clock = (int)(t->clock_khz / 10);

	d[0] = (uint8_t)clock;
	d[1] = (uint8_t)(clock >> 8);
	d[2] = (uint8_t)t->width;
	d[3] = (uint8_t)t->h_blank;
	d[4] = (uint8_t)(t->width >> 8 << 4 | t->h_blank >> 8);
	d[5] = (uint8_t)t->height;
	d[6] = (uint8_t)t->v_blank;
	d[7] = (uint8_t)(t->height >> 8 << 4 | t->v_blank >> 8);
	d[8] = (uint8_t)t->h_front;
	d[9] = (uint8_t)t->h_sync;
	d[10] = (uint8_t)((t->v_front & 15) << 4 | (t->v_sync & 15));
	d[11] = (uint8_t)(t->h_front >> 8 << 6 | t->h_sync >> 8 << 4 | t->v_front >> 4 << 2 | t->v_sync >> 4);
	d[12] = (uint8_t)w_mm;
	d[13] = (uint8_t)h_mm;
	d[14] = (uint8_t)(w_mm >> 8 << 4 | h_mm >> 8);
	d[15] = d[16] = 0;
	/* Digital separate sync; reduced blanking is H+ V-. */
	d[17] = (uint8_t)(0x1A | (spec->stereo ? 0x40 : 0));
}

/* Descriptors other than timings: tag, then text ended by a newline and filled with blanks. */
static void put_text(uint8_t d[18], uint8_t tag, const char *text)
{
	const size_t n = strnlen(text, 13);

	memset(d, 0, 5);
	d[3] = tag;
	memset(d + 5, ' ', 13);
	memcpy(d + 5, text, n);
	if (n < 13)
		d[5 + n] = '\n';
}

static uint8_t at_least(double value, double least)
{
	return (uint8_t)fmin(255, ceil(fmax(value, least)));
}

static void put_ranges(uint8_t d[18], const struct bb_cvt *t)
{
	const double hz = bb_cvt_rate_hz(t), line_khz = bb_cvt_line_hz(t) / 1e3;

	memset(d, 0, 18);
	d[3] = 0xFD;
	d[5] = (uint8_t)fmin(48, floor(hz));
	d[6] = at_least(hz, 120);
	d[7] = (uint8_t)fmin(30, floor(line_khz));
	d[8] = at_least(line_khz, 140);
	d[9] = at_least((double)t->clock_khz / 1e4, 60);
	d[10] = 1; /* limits only, no timing formula */
	d[11] = '\n';
	memset(d + 12, ' ', 6);
}

/* Ten-bit coordinates: eight high bits in a byte each, the low pairs packed before them. */
static void put_chroma(uint8_t *b, const double xy[4][2])
{
	unsigned int v[8];

	for (int i = 0; i < 8; i++)
		v[i] = (unsigned int)lround(xy[i / 2][i % 2] * 1024) & 1023;
	b[0] = (uint8_t)((v[0] & 3) << 6 | (v[1] & 3) << 4 | (v[2] & 3) << 2 | (v[3] & 3));
	b[1] = (uint8_t)((v[4] & 3) << 6 | (v[5] & 3) << 4 | (v[6] & 3) << 2 | (v[7] & 3));
	for (int i = 0; i < 8; i++)
		b[2 + i] = (uint8_t)(v[i] >> 2);
}

static void seal(uint8_t block[128])
{
	unsigned int sum = 0;

	for (int i = 0; i < 127; i++)
		sum += block[i];
	block[127] = (uint8_t)(0x100 - (sum & 0xFF));
}

static void put_identity(uint8_t *b, const struct sim_edid_spec *spec)
{
	static const uint8_t header[8] = { 0x00, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0xFF, 0x00 };
	const struct sim_edid_model *m = spec->model;
	const int maker = (m->maker[0] - '@') << 10 | (m->maker[1] - '@') << 5 | (m->maker[2] - '@');

	memcpy(b, header, sizeof(header));
	b[8] = (uint8_t)(maker >> 8);
	b[9] = (uint8_t)maker;
	b[10] = (uint8_t)m->product;
	b[11] = (uint8_t)(m->product >> 8);
	for (int i = 0; i < 4; i++)
		b[12 + i] = (uint8_t)(spec->serial >> (8 * i));
	b[16] = 1;
	b[17] = (uint8_t)(m->year - 1990);
	b[18] = 1;
	b[19] = 4;
}

static bool is_srgb(const struct sim_edid_model *m)
{
	static const double srgb[4][2] = SRGB;

	for (int i = 0; i < 8; i++)
		if (fabs(m->chroma[i / 2][i % 2] - srgb[i / 2][i % 2]) > 1e-6)
			return false;
	return true;
}

static void put_base(uint8_t *b, const struct sim_edid_spec *spec, const struct bb_cvt *t)
{
	char text[16];

	put_identity(b, spec);
	b[20] = spec->model->input;
	b[21] = (uint8_t)((spec->model->width_mm + 5) / 10);
	b[22] = (uint8_t)((spec->model->height_mm + 5) / 10);
	b[23] = 120;  /* gamma 2.2 */
	b[24] = is_srgb(spec->model) ? 0x06 : 0x02; /* default colours are sRGB; the first timing is native */
	put_chroma(b + 25, spec->model->chroma);
	memset(b + 38, 0x01, 16);
	put_dtd(b + 54, t, spec);
	put_text(b + 72, 0xFC, spec->model->shown);
	snprintf(text, sizeof(text), "SIM%07u", (unsigned int)(spec->serial % 10000000));
	put_text(b + 90, 0xFF, text);
	put_ranges(b + 108, t);
	b[126] = spec->model->cta;
	seal(b);
}

/* CTA-861: 1080p60, 720p60 and 480p60 by code, RGB range selectable, no overscan. (HDMI inputs want EDID 1.3.) */
static void put_cta(uint8_t *b)
{
	static const uint8_t blocks[] = { 0x43, 16, 4, 1, 0xE2, 0x00, 0x4A };

	memset(b, 0, 128);
	b[0] = 0x02;
	b[1] = 0x03;
	b[2] = 4 + sizeof(blocks);
	b[3] = 0x80; /* underscans IT formats */
	memcpy(b + 4, blocks, sizeof(blocks));
	seal(b);
}

enum bb_status sim_edid_make(const struct sim_edid_spec *spec, uint8_t out[SIM_EDID_MAX_BYTES], size_t *n_out)
{
	struct bb_cvt t;
	const enum bb_status status = bb_cvt_rb(spec->width_px, spec->height_px, spec->rate, &t);

	*n_out = 0;
	if (status != BB_OK)
		return status;
	memset(out, 0, SIM_EDID_MAX_BYTES);
	put_base(out, spec, &t);
	*n_out = 128;
	if (spec->model->cta) {
		put_cta(out + 128);
		*n_out = 256;
	}
	return BB_OK;
}
