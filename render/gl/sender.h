/*
 * render/gl/sender.h: two pixel buffers that take turns: the driver may still read the one while the other is written,
 * so that sending does not wait for drawing. The context must be current.
 */
#ifndef BB_RENDER_GL_SENDER_H
#define BB_RENDER_GL_SENDER_H

#include "render/gl/functions.h"

#define BB_GL_SENDER_BYTES ((size_t)16 << 20) /* at once; more goes in several parts */

struct bb_gl_sender {
	GLuint buffer[2];
	unsigned turn;
};

void bb_gl_sender_init(struct bb_gl_sender *s, const struct bb_gl *gl);
void bb_gl_sender_release(struct bb_gl_sender *s, const struct bb_gl *gl);
/* Puts bytes into the next buffer, which stays bound until _done: texture calls read from offset 0 of it. False: the
 * driver has no memory. */
bool bb_gl_sender_put(struct bb_gl_sender *s, const struct bb_gl *gl, const void *bytes, size_t n);
void bb_gl_sender_done(const struct bb_gl *gl);

#endif
