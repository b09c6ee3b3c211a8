/*
 * drivers/attached.h: what is plugged into this machine that the drivers here could open, as sysfs tells it, and
 * whether a room's device is among it. Nothing is opened and nothing is started: looking must not move a shutter or a
 * relay. Paths are read below a root folder ("" for the machine itself), so that a tree of files can stand for a
 * machine.
 */
#ifndef BB_DRIVERS_ATTACHED_H
#define BB_DRIVERS_ATTACHED_H

#include "hal/uri.h"

#define BB_ATTACHED_MAX 1024 /* 480 I2C buses of a wall and all the rest */

struct bb_attached {
	const char *scheme;       /* "i2c" */
	char device[96];          /* what a room file would say: "i2c:/dev/i2c-4", "usb:045e:0719?serial=A1" */
	char node[64];            /* "/dev/i2c-4"; empty for a network interface */
	char what[120];           /* what it calls itself, with its serial number */
	uint16_t vendor, product; /* 0: it has none */
	char serial[64];
	bool known;  /* a driver here understands it */
	bool usable; /* this process may read and write the node; a network interface is up */
};

/* Those of all schemes, sorted by name within each; beyond cap they are left out. */
size_t bb_attached_list(const char *root, struct bb_attached *out, size_t cap);

enum bb_attached_state {
	BB_ATTACHED_HERE, /* attached and usable */
	BB_ATTACHED_MISSING,
	BB_ATTACHED_REFUSED, /* there, but not for this process, or not up */
	BB_ATTACHED_UNSEEN,  /* nothing on this machine can tell */
};

struct bb_attached_answer {
	enum bb_attached_state state;
	char why[200]; /* empty when it is here */
	char remedy[200];
	size_t found; /* which of the list; n when none */
};

/* Is the device of this URI in the list? A strip on TCP is asked for a connection, 300 ms at most. */
void bb_attached_match(const char *root, const struct bb_attached *list, size_t n, const struct bb_uri *uri,
		       struct bb_attached_answer *out);

#endif
