/*
 * drivers/trackir_wire.h: numbers of the TrackIR-class wire: ids, endpoints, commands, packet kinds. Constants only:
 * the driver's codec and the simulated camera share nothing else.
 *
 * A host sends commands of 1 to 6 bytes on the bulk OUT endpoint. A camera answers on bulk IN with replies (byte 1 =
 * 0x20 status, 0x40 configuration) and, while video is on, one packet a frame:
 *
 *   byte 0 number (counts frames, 8 bits)   1 0x10   2 kind   3 makes the XOR of bytes 0..3 0xAA
 *   stripes                                 last 4: size of the packet less 8, big-endian
 *
 * A stripe (kind 5) is 8 bytes, bit fields from the highest bit: column of its first point 10, line 9, points 10,
 * sum of weight times offset from the first point 20, sum of weights 15. Kind 0 has 4-byte stripes without sums.
 *
 * Kind 6 is ours, for cameras with a sync input and a clock, which the original has not: after the header come 12
 * bytes, big-endian: frame counter 32, microseconds at mid-exposure 32, USB frame number (ms, 11 bits) 16, zero 16;
 * then stripes as in kind 5. Such a camera also takes SYNC_OFFSET.
 */
#ifndef BB_DRIVERS_TRACKIR_WIRE_H
#define BB_DRIVERS_TRACKIR_WIRE_H

#define TRACKIR_VENDOR 0x131D
#define TRACKIR_TIR5 0x0157
#define TRACKIR_ENDPOINT_OUT 0x01
#define TRACKIR_ENDPOINT_IN 0x82
#define TRACKIR_WIDTH_PX 640
#define TRACKIR_HEIGHT_PX 480
#define TRACKIR_READ_BYTES 16384 /* the most one packet can have */
#define TRACKIR_COMMAND_MAX 8

#define TRACKIR_CMD_LEDS 0x10        /* leds, mask */
#define TRACKIR_CMD_FLUSH 0x12
#define TRACKIR_CMD_STOP 0x13
#define TRACKIR_CMD_VIDEO 0x14       /* 0 on, 1 off */
#define TRACKIR_CMD_THRESHOLD 0x15   /* threshold, 1, 0 */
#define TRACKIR_CMD_GET_CONFIG 0x17
#define TRACKIR_CMD_SET 0x19         /* sub-command, ... */
#define TRACKIR_CMD_FPGA_INIT 0x1B
#define TRACKIR_CMD_FIRMWARE 0x1C    /* n <= 60, bytes */
#define TRACKIR_CMD_GET_STATUS 0x1D
#define TRACKIR_CMD_RELOAD 0x20
#define TRACKIR_CMD_REGISTER 0x23    /* 42, 08 or 10, value, 0, 0: high and low byte of the exposure in lines */
#define TRACKIR_CMD_SYNC_OFFSET 0x2F /* ours: microseconds, 32 bits big-endian */

#define TRACKIR_REGISTER_SENSOR 0x42
#define TRACKIR_EXPOSURE_HIGH 0x08
#define TRACKIR_EXPOSURE_LOW 0x10
#define TRACKIR_SET_START 0x05       /* 10 10 00 */
#define TRACKIR_LED_IR 0x80
#define TRACKIR_LED_ALL 0xF0
#define TRACKIR_THRESHOLD_LEAST 30
#define TRACKIR_THRESHOLD_MOST 253
#define TRACKIR_LINE_NS 16000        /* one line of exposure: 399 lines are the original's default; unverified */

#define TRACKIR_TYPE_STRIPES4 0x1C   /* the older cameras' packets */
#define TRACKIR_TYPE_PACKET 0x10
#define TRACKIR_TYPE_STATUS 0x20
#define TRACKIR_TYPE_CONFIG 0x40
#define TRACKIR_KIND_SHORT 0
#define TRACKIR_KIND_VIDEO 3
#define TRACKIR_KIND_LONG 5
#define TRACKIR_KIND_STAMPED 6
#define TRACKIR_XOR 0xAA
#define TRACKIR_STAMP_BYTES 12

#endif
