/*
 * sync/plan/tokens.h: what an emitter sends to shutter glasses, as data: bursts of infrared in us, on, off, on, ...
 *
 * Sources: 3DVisionAVR (IRProtocols.h) and open-3d-oled (ir_glasses.h), which follow A. Woods and J. Helliwell, "A survey
 * of 3D sync IR protocols", 2011; `verified`: read in one of them, and used with real glasses there. The survey's tables of
 * CrystalEyes and NuVision were not to be had: those rows carry no numbers. Add yours when you have measured them.
 */
#ifndef BB_SYNC_PLAN_TOKENS_H
#define BB_SYNC_PLAN_TOKENS_H

#include "hal/base.h"

#define BB_TOKEN_PARTS 16
#define BB_TOKEN_SPACING_US 30 /* between two tokens, at least: what open-3d-oled keeps */

enum bb_token { BB_TOKEN_OPEN_LEFT, BB_TOKEN_CLOSE_LEFT, BB_TOKEN_OPEN_RIGHT, BB_TOKEN_CLOSE_RIGHT, BB_TOKENS };

struct bb_ir_protocol {
	const char *name, *glasses;
	bool verified;
	/* One token does both: OPEN_LEFT closes the right lens and OPEN_RIGHT the left one; no gap between them. */
	bool paired;
	uint16_t acts_us;             /* the lens switches so long after the token's begin; 0: at its end */
	uint16_t token[BB_TOKENS][BB_TOKEN_PARTS]; /* on, off, on, ..., 0 */
};

/* By the name a room file uses; NULL: there is none. */
const struct bb_ir_protocol *bb_ir_protocol(const char *name);
const struct bb_ir_protocol *bb_ir_protocol_nth(size_t i); /* NULL past the end */
/* Are there any timings? */
bool bb_ir_known(const struct bb_ir_protocol *p);
double bb_token_us(const struct bb_ir_protocol *p, enum bb_token token); /* first light to last; 0: no such token */
/* Begin of the token before the instant its lens switches. */
double bb_token_lead_us(const struct bb_ir_protocol *p, enum bb_token token);
/* From one lens closing to the other opening: what the protocol allows. Paired: none. */
double bb_ir_least_gap_us(const struct bb_ir_protocol *p);

struct bb_light_span { /* the emitter shines from .. to, us after the edge of the left eye, from in [0, cycle) */
	double from, to;
	enum bb_token token;
};
/* What is sent in a cycle of two periods: each lens opens glasses_at after its edge and closes after glasses_open; at most
 * BB_TOKENS spans, rising. */
size_t bb_ir_spans(const struct bb_ir_protocol *p, double period_us, double glasses_at_us, double glasses_open_us,
                   struct bb_light_span spans[BB_TOKENS]);

#endif
