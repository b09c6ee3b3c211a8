/*
 * drivers/pad_wire.h: what gamepads and 6-DOF controllers put on their wires: identities, places of bytes, bits.
 * Constants only: the drivers and the simulated far ends share them, never the code that reads or writes them.
 * Sources: recorded reports of 046D:C218 and C219, the kernel's lg2ff and xpad, xboxdrv's PROTOCOL, vrpn, spacenavd.
 */
#ifndef BB_DRIVERS_PAD_WIRE_H
#define BB_DRIVERS_PAD_WIRE_H

enum {
	PAD_WIRE_VENDOR_LOGITECH = 0x046D,
	PAD_WIRE_VENDOR_3DCONNEXION = 0x256F,
	PAD_WIRE_VENDOR_MICROSOFT = 0x045E,
	PAD_WIRE_RUMBLEPAD2_WIRED = 0xC218,
	PAD_WIRE_RUMBLEPAD2_WIRELESS = 0xC219,
	PAD_WIRE_SPACENAVIGATOR = 0xC626,
	PAD_WIRE_SPACEEXPLORER = 0xC627,
	PAD_WIRE_SPACENAVIGATOR_NOTEBOOK = 0xC628,
	PAD_WIRE_SPACEPILOT_PRO = 0xC629,
	PAD_WIRE_SPACEMOUSE_PRO = 0xC62B,
	PAD_WIRE_SPACEMOUSE_WIRELESS = 0xC62E, /* on its cable */
	PAD_WIRE_SPACEMOUSE_RECEIVER = 0xC62F,
	PAD_WIRE_SPACEMOUSE_PRO_WIRELESS = 0xC631,
	PAD_WIRE_SPACEMOUSE_PRO_RECEIVER = 0xC632,
	PAD_WIRE_SPACEMOUSE_COMPACT = 0xC635,
	PAD_WIRE_XBOX_RECEIVER = 0x0719,
	PAD_WIRE_XBOX_RECEIVER_OLD = 0x0291,
	PAD_WIRE_XBOX_RECEIVER_CLONE = 0x02A9,

	/* RumblePad 2: X Y Z Rz, hat and buttons 1-4, buttons 5-12, two bytes of the maker's own. The wireless one has
	 * a report id before and one byte less behind: eight bytes on both. */
	PAD_WIRE_RUMBLEPAD_ID = 0x01,
	PAD_WIRE_RUMBLEPAD_BYTES = 8,
	PAD_WIRE_RUMBLEPAD_CENTRE_X = 0x80,
	PAD_WIRE_RUMBLEPAD_CENTRE_Y = 0x7F,
	PAD_WIRE_HAT_UP = 0, /* and clockwise to 7 */
	PAD_WIRE_HAT_CENTRE = 8,
	PAD_WIRE_RUMBLE_SET = 0x51,      /* wired: 51 00 weak 00 strong 00 00 (the kernel's lg2ff) */
	PAD_WIRE_RUMBLE_STOP = 0xF3,     /* F3 00 00 00 00 00 00 */
	PAD_WIRE_RUMBLE_WIRELESS = 0x42, /* wireless: 42 00 weak strong 00 00 00 (lgff, which has C219) */
	PAD_WIRE_RUMBLE_BYTES = 7,

	/* 3Dconnexion: report ids. */
	PAD_WIRE_SPACE_MOVE = 0x01, /* three i16, or all six on newer wireless ones */
	PAD_WIRE_SPACE_TURN = 0x02,
	PAD_WIRE_SPACE_BUTTONS = 0x03,
	PAD_WIRE_SPACE_LED = 0x04,
	PAD_WIRE_SPACE_BATTERY = 0x17, /* percent */
	PAD_WIRE_SPACE_COUNTS = 350,   /* from neutral to the end of an axis; some give up to 400 */

	/* Xbox 360 wireless receiver: pads on interfaces 0, 2, 4, 6, endpoints 1, 3, 5, 7 in both directions. */
	PAD_WIRE_XBOX_SLOTS = 4,
	PAD_WIRE_XBOX_STATUS_BYTES = 2,
	PAD_WIRE_XBOX_STATUS = 0x08, /* then 00 nothing, 40 headset, 80 pad, C0 both */
	PAD_WIRE_XBOX_STATUS_PAD = 0x80,
	PAD_WIRE_XBOX_STATUS_HEADSET = 0x40,
	PAD_WIRE_XBOX_BYTES = 29,
	PAD_WIRE_XBOX_HAS_PAD_DATA = 0x01, /* byte 1 */
	PAD_WIRE_XBOX_LINK = 0x0F,         /* byte 1: serial number and the like, once after joining */
	PAD_WIRE_XBOX_LED_STATUS = 0xF8,   /* byte 1 */
	PAD_WIRE_XBOX_BATTERY = 0x13,      /* byte 3, the three before are 0; byte 4 is the level */
	PAD_WIRE_XBOX_AT_BITS = 6,
	PAD_WIRE_XBOX_AT_TRIGGERS = 8,
	PAD_WIRE_XBOX_AT_STICKS = 10, /* LX LY RX RY, i16, Y up */
	PAD_WIRE_XBOX_COMMAND_BYTES = 12,
};

#endif
