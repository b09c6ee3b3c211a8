/*
 * drivers/trackir_codec.h: the bytes of a TrackIR-class camera as the host sees them (trackir_wire.h has the format):
 * commands out, replies and packets in, stripes grouped to blobs. Pure, no state but the caller's, any thread.
 * Coordinates in px, pixel (0,0) is the centre of the upper left one.
 */
#ifndef BB_DRIVERS_TRACKIR_CODEC_H
#define BB_DRIVERS_TRACKIR_CODEC_H

#include "drivers/trackir_wire.h"
#include "hal/camera.h"

struct trackir_command {
	uint8_t bytes[TRACKIR_COMMAND_MAX];
	size_t n;
};
struct trackir_command trackir_simple(uint8_t command);
struct trackir_command trackir_video(bool on);
struct trackir_command trackir_leds(uint8_t leds, uint8_t mask);
struct trackir_command trackir_threshold(uint8_t threshold);
struct trackir_command trackir_start_set(void);
/* Two commands. lines: 1..65535. */
void trackir_exposure(uint32_t lines, struct trackir_command out[2]);
struct trackir_command trackir_sync_offset(uint32_t offset_us);
/* The checksum the camera keeps of a firmware it was sent. */
uint16_t trackir_firmware_sum(const uint8_t *bytes, size_t n);

struct trackir_status {
	bool firmware_loaded;
	uint16_t firmware_sum;
	uint8_t config_flag; /* 1 reload needed, 2 ready */
};

#define TRACKIR_STRIPES_MAX ((TRACKIR_READ_BYTES - 8) / 4)

struct trackir_stripe {
	uint16_t line, first, points; /* columns first .. first + points - 1 */
	uint32_t sum_x, sum;
};
struct trackir_packet {
	uint8_t number, kind;
	bool stamped;
	uint32_t counter, mid_us;
	uint16_t usb_frame;
	size_t n;
	struct trackir_stripe stripe[TRACKIR_STRIPES_MAX];
};

enum trackir_item { TRACKIR_NOTHING, TRACKIR_STATUS, TRACKIR_CONFIG, TRACKIR_FRAME };

/* Puts packets together from USB transfers. */
struct trackir_stream {
	uint8_t bytes[TRACKIR_READ_BYTES];
	size_t n;                     /* of a packet under way */
	uint64_t n_partial, n_bad;    /* dropped: their end never came; not what they claim to be */
	struct trackir_status status; /* after TRACKIR_STATUS */
	uint8_t config;               /* after TRACKIR_CONFIG: first byte of the reply */
	struct trackir_packet packet; /* after TRACKIR_FRAME */
};
void trackir_stream_init(struct trackir_stream *s);
/* One completed IN transfer. What it brought to an end stands in *s. */
enum trackir_item trackir_stream_add(struct trackir_stream *s, const uint8_t *bytes, size_t n);

/* A whole packet; false: not one. */
BB_MUST_CHECK bool trackir_packet_read(const uint8_t *bytes, size_t n, struct trackir_packet *out);
/* The older cameras' packet (type 1C), stripes only; a frame of theirs ends at an all-zero stripe or where the line
 * number falls, which the caller sees in the stripes. */
BB_MUST_CHECK bool trackir_packet4_read(const uint8_t *bytes, size_t n, struct trackir_packet *out);

/* Stripes of one frame, lines ascending, to blobs sorted by y, then x. Returns how many fit; *overflow: there are more.
 * Stripes that touch on neighbouring lines are one blob; its centre is weighted, its area counts points. */
size_t trackir_blobs(const struct trackir_packet *packet, struct bb_blob *blobs, size_t cap, bool *overflow);

#endif
