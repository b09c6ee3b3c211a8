/*
 * render/stream/io.h: the brick reader as a thread, for the posix clock. Selection is the same code as on the virtual
 * clock; only the moment a brick can be drawn differs: there at once, here at the first frame after it has been read. A
 * frame never waits for the reader: it takes what is ready and draws the rest from the coarse copy.
 *
 * All calls below belong to the thread that calls bb_stream_frame.
 */
#ifndef BB_RENDER_STREAM_IO_H
#define BB_RENDER_STREAM_IO_H

#include "render/stream/stream.h"

struct bb_stream_io;

/* From here on bricks are read by a thread of its own. One reader a stream. */
BB_MUST_CHECK enum bb_status bb_stream_io_start(struct bb_stream *s, struct bb_stream_io **out);
/* Waits until everything asked for has been read; the next frame (or stop) may draw it. For pictures and tests. */
void bb_stream_io_drain(struct bb_stream_io *io);
/* Reads what is still asked for, ends the thread and gives the stream back to reading at once. NULL is allowed. Stop
 * before bb_stream_destroy. */
void bb_stream_io_stop(struct bb_stream_io *io);

#endif
