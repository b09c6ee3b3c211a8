/*
 * hal/monitor.h: a monitor's own controls: EDID, VCP get and set (DDC/CI, MCCS 2.2), power mode, identity, hours.
 *
 * DDC/CI is slow (40-50 ms a step), so a request is submitted and polled for: the driver is a state machine on the
 * clock's timers and one request is outstanding per monitor.
 */
#ifndef BB_HAL_MONITOR_H
#define BB_HAL_MONITOR_H

#include "hal/device.h"

#define BB_VCP_NEW_CONTROL 0x02
#define BB_VCP_RESTORE_DEFAULTS 0x04
#define BB_VCP_LUMINANCE 0x10
#define BB_VCP_CONTRAST 0x12
#define BB_VCP_COLOR_PRESET 0x14
#define BB_VCP_RED_GAIN 0x16
#define BB_VCP_GREEN_GAIN 0x18
#define BB_VCP_BLUE_GAIN 0x1A
#define BB_VCP_INPUT 0x60
#define BB_VCP_H_FREQUENCY 0xAC
#define BB_VCP_V_FREQUENCY 0xAE
#define BB_VCP_SETTINGS 0xB0
#define BB_VCP_HOURS 0xC0
#define BB_VCP_ENABLE_KEY 0xC6
#define BB_VCP_CONTROLLER 0xC8
#define BB_VCP_POWER_MODE 0xD6
#define BB_VCP_VERSION 0xDF

struct bb_monitor_setting {
	int64_t code, value;
};
#define BB_MONITOR_SETTINGS_MAX 16

struct bb_monitor_config {
	char id[BB_ID_MAX];
	char node[BB_ID_MAX];
	char device[160];
	char edid[BB_ID_MAX];          /* model name for generated EDIDs, e.g. "S27A850D"; "" = a generic one */
	char outlet[2 * BB_ID_MAX];    /* "pdu1/2" feeds it; "" = always fed */
	int64_t width_px, height_px;
	struct bb_rate rate;
	int64_t input;                 /* VCP 60 value it must show, e.g. 0x0F DisplayPort-1 */
	size_t n_settings;
	struct bb_monitor_setting setting[BB_MONITOR_SETTINGS_MAX]; /* wanted at bring-up, verified by read-back */
};

struct bb_monitor_limits {
	int64_t reply_wait_ns, write_wait_ns; /* DDC/CI 1.1: 40 ms before reading a reply, 50 ms after a write */
	int64_t transfer_ns;     /* beyond those waits: one transfer takes up to that long, on the wire and to get there */
	int64_t most_request_ns; /* with every try and question in between; CAPABILITIES: each 32 bytes of text */
	uint32_t most_tries;
};

enum bb_monitor_request_kind {
	BB_MONITOR_EDID,
	BB_MONITOR_GET,
	BB_MONITOR_SET,
	BB_MONITOR_CAPABILITIES, /* the display's own list of what it has, as text */
	BB_MONITOR_SAVE,         /* always BB_ERR_REFUSED (hal/safety.h) */
};
struct bb_monitor_request {
	enum bb_monitor_request_kind kind;
	uint8_t code;
	uint16_t value;       /* SET */
};
#define BB_EDID_MAX_BYTES 1024
#define BB_MONITOR_TEXT_MAX 2048
struct bb_monitor_reply {
	struct bb_monitor_request request;
	enum bb_status status; /* BB_OK; BB_ERR_UNSUPPORTED: code unknown; BB_ERR_BUSY: gave up after Null replies
	                          (standby answers EDID but not VCP); BB_ERR_LOST: no ACK; BB_ERR_RANGE: illegal value;
	                          BB_ERR_REFUSED: safety; BB_ERR_FORMAT: only damaged replies came, of an EDID with the
	                          bytes as they are; BB_ERR_IO: the bus failed; BB_ERR_VERIFY: the value written was
	                          acknowledged and reads back as another, which is in current */
	uint16_t current, most; /* GET; both are 0xFFFF for "cannot determine" */
	uint32_t tries;
	int64_t done_ns;
	size_t edid_bytes;      /* EDID: 128 x (1 + extensions), bounded. With BB_OK every block's checksum and the header
	                           are right and no block that is announced is missing, up to the bound */
	size_t text_bytes;      /* CAPABILITIES: without a NUL, bounded */
	union {                 /* only as many bytes as told above are set */
		uint8_t edid[BB_EDID_MAX_BYTES];
		char text[BB_MONITOR_TEXT_MAX];
	};
};

struct bb_monitor;
struct bb_monitor_driver;

BB_MUST_CHECK enum bb_status bb_monitor_open(const struct bb_monitor_driver *driver,
                                             const struct bb_monitor_config *config, const struct bb_open *open,
                                             struct bb_monitor **out);
void bb_monitor_close(struct bb_monitor *m);
const struct bb_monitor_limits *bb_monitor_limits(const struct bb_monitor *m);
/* BB_ERR_BUSY while a request is outstanding; BB_ERR_REFUSED for D6 = 5 and for saving (hal/safety.h). */
BB_MUST_CHECK enum bb_status bb_monitor_submit(struct bb_monitor *m, const struct bb_monitor_request *request);
/* BB_OK once when the reply is there (its own status says how it went); BB_TIMEOUT while under way or idle. */
BB_MUST_CHECK enum bb_status bb_monitor_poll(struct bb_monitor *m, struct bb_monitor_reply *reply);
struct bb_device *bb_monitor_device(struct bb_monitor *m);

#endif
