#include "sync/plan/tokens.h"

#include <math.h>
#include <string.h>

static const struct bb_ir_protocol protocols[] = {
	{ "3d-vision", "NVIDIA 3D Vision", true, false, 0,
	  { { 43 }, { 23, 21, 24 }, { 23, 46, 31 }, { 23, 78, 40 } } },
	{ "xpand", "XpanD X101..X103", true, true, 0,
	  { [BB_TOKEN_OPEN_LEFT] = { 18, 60, 18 }, [BB_TOKEN_OPEN_RIGHT] = { 18, 20, 18, 20, 18 } } },
	{ "sony", "Sony TDG", true, false, 1000,
	  { { 20, 20, 20, 20, 20, 220, 20, 20, 20 },
	    { 20, 20, 20, 20, 20, 140, 20, 20, 20 },
	    { 20, 20, 20, 20, 20, 380, 20, 20, 20 },
	    { 20, 20, 20, 20, 20, 300, 20, 20, 20 } } },
	{ "panasonic", "Panasonic TY-EW3D", true, false, 0,
	  { { 20, 60, 20, 20, 20, 60, 20 },
	    { 20, 20, 20, 100, 20, 20, 20 },
	    { 20, 20, 20, 60, 20, 60, 20 },
	    { 20, 60, 20, 60, 20, 20, 20 } } },
	{ "sharp", "Sharp AN-3DG", true, true, 0,
	  { [BB_TOKEN_OPEN_LEFT] = { 20, 20, 20, 20, 20, 60, 20, 60, 20, 20, 20, 80, 20, 20, 20 },
	    [BB_TOKEN_OPEN_RIGHT] = { 20, 20, 20, 20, 20, 80, 20, 140, 20, 20, 20, 80, 20, 20, 20 } } },
	{ "elsa", "ELSA Revelator", true, true, 0,
	  { [BB_TOKEN_OPEN_LEFT] = { 11, 16, 15, 16, 15, 47, 15, 16, 15, 16, 15 },
	    [BB_TOKEN_OPEN_RIGHT] = { 11, 16, 15, 16, 15, 16, 15, 16, 15, 47, 15 } } },
	{ "epson", "Epson ELPGS01 (which code is left is not known)", true, false, 0,
	  { { 20, 60, 20, 60, 20, 20, 20 },
	    { 20, 60, 20, 20, 20, 60, 20 },
	    { 20, 20, 20, 100, 20, 20, 20 },
	    { 20, 20, 20, 60, 20, 60, 20 } } },
	{ "crystaleyes", "StereoGraphics CrystalEyes", false, false, 0, { { 0 } } },
	{ "nuvision", "NuVision 60GX, APG6000", false, false, 0, { { 0 } } },
};

const struct bb_ir_protocol *bb_ir_protocol_nth(size_t i)
{
	return i < BB_ARRAY_LEN(protocols) ? &protocols[i] : NULL;
}

const struct bb_ir_protocol *bb_ir_protocol(const char *name)
{
	for (size_t i = 0; i < BB_ARRAY_LEN(protocols); i++)
		if (!strcmp(protocols[i].name, name))
			return &protocols[i];
	return NULL;
}

double bb_token_us(const struct bb_ir_protocol *p, enum bb_token token)
{
	double sum = 0;

	for (size_t i = 0; i < BB_TOKEN_PARTS; i++)
		sum += p->token[token][i];
	return sum;
}

bool bb_ir_known(const struct bb_ir_protocol *p)
{
	return p && bb_token_us(p, BB_TOKEN_OPEN_LEFT) > 0;
}

double bb_token_lead_us(const struct bb_ir_protocol *p, enum bb_token token)
{
	return p->acts_us ? p->acts_us : bb_token_us(p, token);
}

double bb_ir_least_gap_us(const struct bb_ir_protocol *p)
{
	double gap = 0;

	for (int eye = 0; eye < 2 && !p->paired; eye++) { /* a lens's close token, then the other's open token */
		const enum bb_token close = eye ? BB_TOKEN_CLOSE_RIGHT : BB_TOKEN_CLOSE_LEFT;
		const enum bb_token open = eye ? BB_TOKEN_OPEN_LEFT : BB_TOKEN_OPEN_RIGHT;
		const double after = bb_token_us(p, close) + BB_TOKEN_SPACING_US - bb_token_lead_us(p, close) +
				     bb_token_lead_us(p, open);
		gap = fmax(gap, after);
	}
	return gap;
}

size_t bb_ir_spans(const struct bb_ir_protocol *p, double period_us, double glasses_at_us, double glasses_open_us,
                   struct bb_light_span spans[BB_TOKENS])
{
	const double cycle = 2 * period_us;
	size_t n = 0;

	for (int t = 0; t < BB_TOKENS; t++) {
		const bool right = t == BB_TOKEN_OPEN_RIGHT || t == BB_TOKEN_CLOSE_RIGHT;
		const bool closes = t == BB_TOKEN_CLOSE_LEFT || t == BB_TOKEN_CLOSE_RIGHT;
		const double length = bb_token_us(p, (enum bb_token)t);
		const double acts = glasses_at_us + (right ? period_us : 0) + (closes ? glasses_open_us : 0);
		double from = fmod(acts - bb_token_lead_us(p, (enum bb_token)t), cycle);
		size_t i = n;

		if (!(length > 0))
			continue;
		from += from < 0 ? cycle : 0;
		for (; i > 0 && spans[i - 1].from > from; i--)
			spans[i] = spans[i - 1];
		spans[i] = (struct bb_light_span){ from, from + length, (enum bb_token)t };
		n++;
	}
	return n;
}
