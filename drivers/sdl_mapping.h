/*
 * drivers/sdl_mapping.h: lines as in SDL_GameControllerDB, "GUID,name,target:source,...,platform:Linux,", from a file
 * of the user's. Sources: bN button, aN axis (+aN, -aN half of one, aN~ turned round), hN.M hat bit (1 up, 2 right, 4
 * down, 8 left). A file is hostile: at most 4 MiB, lines and bindings counted. Errors 1564 (a bad line), 1565 (no
 * line).
 */
#ifndef BB_DRIVERS_SDL_MAPPING_H
#define BB_DRIVERS_SDL_MAPPING_H

#include "hal/bus_input.h"

enum bb_sdl_target { /* in the order of the buttons' bits, then crosses, axes and triggers */
		     BB_SDL_A,
		     BB_SDL_B,
		     BB_SDL_X,
		     BB_SDL_Y,
		     BB_SDL_LEFT_SHOULDER,
		     BB_SDL_RIGHT_SHOULDER,
		     BB_SDL_BACK,
		     BB_SDL_START,
		     BB_SDL_GUIDE,
		     BB_SDL_LEFT_STICK,
		     BB_SDL_RIGHT_STICK,
		     BB_SDL_UP,
		     BB_SDL_DOWN,
		     BB_SDL_LEFT,
		     BB_SDL_RIGHT,
		     BB_SDL_LEFT_X,
		     BB_SDL_LEFT_Y,
		     BB_SDL_RIGHT_X,
		     BB_SDL_RIGHT_Y,
		     BB_SDL_LEFT_TRIGGER,
		     BB_SDL_RIGHT_TRIGGER,
		     BB_SDL_TARGETS
};

enum bb_sdl_source { BB_SDL_FROM_BUTTON, BB_SDL_FROM_AXIS, BB_SDL_FROM_HAT };

#define BB_SDL_BINDINGS_MAX 32
struct bb_sdl_binding {
	enum bb_sdl_target target;
	int target_half; /* -1, +1: half of an axis; 0 all */
	enum bb_sdl_source source;
	uint8_t index;   /* of the button, axis or hat */
	uint8_t hat_bit; /* 1, 2, 4, 8 */
	int half;        /* -1, +1: half of the axis; 0 all */
	bool turned;
};

struct bb_sdl_mapping {
	uint8_t guid[16];
	char name[64];
	size_t n;
	struct bb_sdl_binding binding[BB_SDL_BINDINGS_MAX];
};

/* The GUID SDL gives a device on Linux, without the name's checksum. */
void bb_sdl_guid(const struct bb_input_identity *id, uint8_t out[16]);
/* One line of n bytes. BB_SKIPPED: empty, a comment, or of another platform. */
BB_MUST_CHECK enum bb_status bb_sdl_mapping_parse(const char *line, size_t n, const struct bb_where *where,
						  struct bb_sdl_mapping *out, struct bb_error *err);
/* The line of a device: the one with its version, else the first with its vendor and product. Other lines are not
 * looked into. */
BB_MUST_CHECK enum bb_status bb_sdl_mapping_find(const char *text, size_t n, const char *file,
						 const struct bb_input_identity *id, struct bb_sdl_mapping *out,
						 struct bb_error *err);

#endif
