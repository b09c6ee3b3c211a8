/*
 * sim/bus_sim_line.h: the far end of a GPIO line: a stereo sync generator and the kernel's event queue before it, on the
 * virtual clock, with what goes wrong with either. One open bus at a time.
 *
 * Model. Edge n is due at a time computed from n; even edges make the line high (left eye), odd ones low. An edge is an
 * event only if the level changes. numbered: the queue of the v2 interface, as long as asked for, the oldest event
 * dropped when it is full, every event numbered; else that of v1: 16 events, the newest dropped, nothing numbered.
 * Events are made when somebody looks, so a generator that nobody hears costs nothing.
 */
#ifndef BB_SIM_BUS_SIM_LINE_H
#define BB_SIM_BUS_SIM_LINE_H

#include "hal/bus.h"

struct sim_line;
struct sim_line_config {
	struct bb_rate rate;      /* edges a second */
	double rate_error_ppm;
	double jitter_us;         /* standard deviation, cut at 4 */
	int64_t begin_ns;         /* edge 0 */
	bool numbered;
	uint64_t seed;
};

BB_MUST_CHECK enum bb_status sim_line_create(struct bb_clock *clk, const struct sim_line_config *config,
                                             struct sim_line **out);
void sim_line_destroy(struct sim_line *p); /* after the bus was closed; NULL is allowed */
const struct bb_line_opener *sim_line_opener(struct sim_line *p);

/* Verbs. All take effect now. */
void sim_line_stuck(struct sim_line *p, bool on);                       /* the level stays */
void sim_line_bounce(struct sim_line *p, unsigned n, int64_t after_ns); /* n edges are followed by a pulse */
void sim_line_miss(struct sim_line *p, unsigned n);                     /* n interrupts are lost */
void sim_line_overflow(struct sim_line *p, unsigned n);                 /* n events fall out of the queue */
void sim_line_jitter(struct sim_line *p, int64_t peak_ns);              /* uniform, on top; 0: off */
void sim_line_rate(struct sim_line *p, struct bb_rate rate, double rate_error_ppm); /* phase goes on */
void sim_line_invert(struct sim_line *p);                               /* the level flips, and stays flipped */
void sim_line_vanish(struct sim_line *p, int os_errno); /* the chip is gone, opens fail with that; 0: back */

/* What the world sees. */
bool sim_line_out(const struct sim_line *p);       /* level of the output line */
int64_t sim_line_out_ns(const struct sim_line *p); /* since when */
bool sim_line_is_open(const struct sim_line *p);
/* Is the level high just after the newest edge at or before now, whatever the bus hears of it? */
bool sim_line_level(struct sim_line *p);
uint64_t sim_line_edges(struct sim_line *p);       /* changes of the level so far, bounces not counted */

#endif
