#include "render/gl/sender.h"

#include <string.h>

void bb_gl_sender_init(struct bb_gl_sender *s, const struct bb_gl *gl)
{
	*s = (struct bb_gl_sender){ 0 };
	gl->GenBuffers(2, s->buffer);
}

void bb_gl_sender_release(struct bb_gl_sender *s, const struct bb_gl *gl)
{
	gl->DeleteBuffers(2, s->buffer);
	*s = (struct bb_gl_sender){ 0 };
}

/* New storage each time: the driver keeps the old one for as long as it reads from it. */
bool bb_gl_sender_put(struct bb_gl_sender *s, const struct bb_gl *gl, const void *bytes, size_t n)
{
	s->turn ^= 1;
	gl->BindBuffer(GL_PIXEL_UNPACK_BUFFER, s->buffer[s->turn]);
	gl->BufferData(GL_PIXEL_UNPACK_BUFFER, (GLsizeiptr)n, NULL, GL_STREAM_DRAW);
	void *to = gl->MapBufferRange(GL_PIXEL_UNPACK_BUFFER, 0, (GLsizeiptr)n,
				      GL_MAP_WRITE_BIT | GL_MAP_INVALIDATE_BUFFER_BIT);
	if (to)
		memcpy(to, bytes, n);
	if (to && gl->UnmapBuffer(GL_PIXEL_UNPACK_BUFFER))
		return true;
	bb_gl_sender_done(gl);
	return false;
}

void bb_gl_sender_done(const struct bb_gl *gl)
{
	gl->BindBuffer(GL_PIXEL_UNPACK_BUFFER, 0);
}
