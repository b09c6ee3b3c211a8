/*
 * hal/eventlog.h: everything that happened in a run, as fixed-size records in order of recording. Same room, scene,
 * seed and build on the virtual clock: the same bytes. Records are handed to the sink a full block at a time, so
 * recording neither allocates nor locks. One log belongs to one thread.
 */
#ifndef BB_HAL_EVENTLOG_H
#define BB_HAL_EVENTLOG_H

#include "hal/status.h"

#define BB_EVENT_KINDS(X)                                                                                            \
	X(BB_EV_EDGE, "edge")           /* shutter: a = eye, b = stage */                                             \
	X(BB_EV_FRAME, "frame")         /* camera: a = seq, b = blobs */                                              \
	X(BB_EV_VBLANK, "vblank")       /* display: a = seq */                                                        \
	X(BB_EV_FLIP, "flip")           /* display: a = frame, b = seq */                                             \
	X(BB_EV_REPLY, "reply")         /* monitor: a = request kind << 16 | VCP code, b = value */                   \
	X(BB_EV_OUTLET, "outlet")       /* power: a = outlet, b = contact closed */                                   \
	X(BB_EV_REPORT, "report")       /* gamepad: a = seq, b = buttons */                                           \
	X(BB_EV_MESSAGE, "message")     /* link: a = from << 16 | to, b = bytes */                                    \
	X(BB_EV_FAULT, "fault")         /* world: a = fault number, b = 1 set, 0 cleared */                           \
	X(BB_EV_HEALTH, "health")       /* watch: a = new state, b = old state */                                     \
	X(BB_EV_POSE, "pose")           /* tracker: a = cameras, b = nm of the centroid's x */                        \
	X(BB_EV_SELECT, "select")       /* node: a = bricks wanted, b = bytes streamed */                             \
	X(BB_EV_DRAW, "draw")           /* node: a = frame, b = cost in ns */                                         \
	X(BB_EV_ARRIVE, "arrive")       /* barrier: a = frame, b = node */                                            \
	X(BB_EV_RELEASE, "release")     /* barrier: a = frame, b = nodes missing */                                   \
	X(BB_EV_OUTPUT, "output")       /* eyes, on change: a = shutters open, b = light of the pictures, ppm */       \
	X(BB_EV_ORPHAN, "orphan")       /* node, on change: a = hears nothing of the head, b = light of its walls, ppm */ \
	X(BB_EV_GESTURE, "gesture")     /* wand: a = 1 points elsewhere, 2 takes, 3 lets go; b = screen + 1 << 32 | x << 16 | y */

enum bb_event_kind {
#define X(name, text) name,
	BB_EVENT_KINDS(X)
#undef X
	BB_EV_KIND_COUNT
};

struct bb_event {
	int64_t at_ns;
	int64_t a, b;
	uint16_t source; /* index given by bb_eventlog_source */
	uint16_t kind;
	uint32_t zero;   /* so that the record has no padding: it is hashed as it stands */
};

#define BB_EVENT_BLOCK 1024
#define BB_EVENT_SOURCES_MAX 2048

struct bb_eventlog {
	void (*sink)(void *ctx, const struct bb_event *events, size_t n); /* may be NULL: counted only */
	void *ctx;
	size_t n;
	uint64_t total;
	uint16_t n_sources;
	uint64_t per_source[BB_EVENT_SOURCES_MAX];
	char names[BB_EVENT_SOURCES_MAX][BB_ID_MAX + 12]; /* "camera/c3" */
	struct bb_event block[BB_EVENT_BLOCK];
};

void bb_eventlog_init(struct bb_eventlog *log, void (*sink)(void *, const struct bb_event *, size_t), void *ctx);
/* Registers "class/id" and returns its index; the same name gets the same index; past the maximum the last one. */
uint16_t bb_eventlog_source(struct bb_eventlog *log, const char *class_name, const char *id);
/* A NULL log records nothing. */
void bb_eventlog_add(struct bb_eventlog *log, uint16_t source, enum bb_event_kind kind, int64_t at_ns, int64_t a,
                     int64_t b);
void bb_eventlog_flush(struct bb_eventlog *log);
const char *bb_event_kind_text(enum bb_event_kind kind);

#endif
