/*
 * drivers/ddcci_wire.h: numbers of DDC/CI 1.1, E-DDC and E-EDID that stand on the wire, and the waits of the
 * standard. Constants only: the driver and the simulated display each write their own encoder and decoder. 7-bit
 * addresses.
 */
#ifndef BB_DRIVERS_DDCCI_WIRE_H
#define BB_DRIVERS_DDCCI_WIRE_H

#define DDCCI_ADDRESS 0x37
#define EDID_ADDRESS 0x50
#define EDID_SEGMENT_ADDRESS 0x30 /* E-DDC segment pointer: 256 bytes a segment, forgotten at every stop */

/* Bytes that stand for the two ends. The first two are also the display's 8-bit addresses. */
#define DDCCI_TO_DISPLAY 0x6E
#define DDCCI_FROM_DISPLAY 0x6F
#define DDCCI_HOST 0x51
#define DDCCI_VIRTUAL_HOST 0x50 /* begins the checksum of replies */

#define DDCCI_LENGTH_FLAG 0x80
#define DDCCI_MOST_DATA 35 /* a fragment: opcode, offset, 32 bytes of text */
#define DDCCI_FRAGMENT_TEXT 32

enum ddcci_opcode {
	DDCCI_GET = 0x01,
	DDCCI_GET_REPLY = 0x02,
	DDCCI_SET = 0x03,
	DDCCI_SAVE = 0x0C,
	DDCCI_CAPABILITIES_REPLY = 0xE3,
	DDCCI_IDENTIFICATION_REPLY = 0xE1,
	DDCCI_IDENTIFICATION = 0xF1,
	DDCCI_CAPABILITIES = 0xF3,
};

enum ddcci_result { DDCCI_RESULT_OK = 0, DDCCI_RESULT_UNSUPPORTED = 1 };

#define DDCCI_REPLY_WAIT_NS INT64_C(40000000) /* from the request to reading its reply */
#define DDCCI_WRITE_WAIT_NS INT64_C(50000000) /* after a Set, and between messages in general */
#define DDCCI_SAVE_WAIT_NS INT64_C(200000000)

#define EDID_BLOCK_BYTES 128

#endif
