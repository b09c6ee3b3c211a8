/*
 * drivers/line.h: the two ways to a GPIO line of the kernel, as openers of hal/bus.h. Each wraps one vendor interface.
 *
 * line_uapi2  the kernel's GPIO v2 character device: stamps and sequence numbers of every edge, a buffer of the size
 *             asked for (at most 1024 events). The default.
 * line_gpiod  libgpiod. 1.x speaks the v1 interface: 16 events, newer ones dropped without a word, no numbers
 *             (seq is 0). 2.x is as good as line_uapi2.
 */
#ifndef BB_DRIVERS_LINE_H
#define BB_DRIVERS_LINE_H

#include "hal/bus.h"

extern const struct bb_line_opener bb_line_uapi2;
extern const struct bb_line_opener bb_line_gpiod;

/* Takes over open v2 line descriptors (from a helper with more rights, or a test); they are closed with the bus, and on
 * failure. out_fd -1: no output. */
BB_MUST_CHECK enum bb_status bb_line_uapi2_on(int in_fd, int out_fd, uint32_t line, struct bb_clock *clk,
                                              struct bb_line_bus **out);

/* Number and text for an open that failed with an errno: who and what as the caller knows them. */
enum bb_status bb_line_open_failed(const struct bb_line_request *request, int os_errno, const char *held_by,
                                   struct bb_error *err);

/*
 * The bytes a v2 line descriptor yields, taken with distrust: a record of another line, without a known edge, from the
 * future or earlier than its predecessor is dropped and counted, and the next good event says that some were lost.
 */
struct bb_line_reader {
	struct bb_clock *clk;
	uint32_t line;
	bool any, lost;
	uint32_t seq;
	int64_t at_ns;
	uint64_t n_malformed;
};
#define BB_LINE_RECORD_BYTES 48
/* Decodes whole records until the bytes or the room end; returns the number of bytes used up. */
size_t bb_line_decode(struct bb_line_reader *r, const uint8_t *bytes, size_t n_bytes, struct bb_line_event *events,
                      size_t cap, size_t *n_out);

#endif
