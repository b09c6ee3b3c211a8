/*
 * drivers/shutter_gpio.h: stereo sync on one GPIO line: gpio:/dev/gpiochip0?line=17.
 *
 * The line is the emitter's stereo sync (VESA 3-pin: high = left eye). Every edge is the glasses switching
 * emitter_offset_us later, and is reported as BB_STAGE_EMITTER; a chain of stages cannot be seen or set by one line.
 * With ?out=N a second line lets the emitter hear the sync (high) or not (low: the glasses go clear by themselves). It
 * is low until stereo is asked for, when the sync is lost beyond its time-box, at another rate, and on close; after such
 * a loss it stays low for at least 2 s. The board must pull it down, because a crash cannot.
 *
 * Options: line, out, active_low (swaps the eyes), bias (as-is|off|up|down), api (uapi2|gpiod), holdover_ppm (how far
 * the room's rate may be off while nobody hears it). No edge waits for a reader longer than 1.5 periods: a timer takes
 * the events of the bus, so a fault is found although nobody reads.
 */
#ifndef BB_DRIVERS_SHUTTER_GPIO_H
#define BB_DRIVERS_SHUTTER_GPIO_H

#include "drivers/edge_lock.h"
#include "hal/shutter_driver.h"

extern const struct bb_shutter_driver bb_shutter_gpio_driver;

/* Opens with another way to the line than the URI's; the opener must outlive the handle. */
BB_MUST_CHECK enum bb_status bb_shutter_gpio_open_on(const struct bb_line_opener *opener,
                                                     const struct bb_shutter_config *config,
                                                     const struct bb_open *open, struct bb_shutter **out);

/* What follows is for handles of this driver only. */
const struct bb_edge_lock *bb_shutter_gpio_lock(const struct bb_shutter *sh);
enum bb_health bb_shutter_gpio_health(const struct bb_shutter *sh);
bool bb_shutter_gpio_gate(const struct bb_shutter *sh); /* may the emitter hear the sync? */
uint64_t bb_shutter_gpio_dropped(const struct bb_shutter *sh); /* edges that nobody read in time */
int bb_shutter_gpio_fd(const struct bb_shutter *sh);           /* readable while events wait; -1: none */

#endif
