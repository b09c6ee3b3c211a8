/*
 * render/stream/io.h: two ways to read bricks later than at once. A thread, for the posix clock: a brick can be drawn at
 * the first frame after it has been read. A model of a disk, for the virtual one: a read begins when the ones before it
 * are over and takes its time, and the disk may stall. Selection is the same code in all cases, and no frame waits.
 *
 * All calls below belong to the thread that calls bb_stream_frame. One loader a stream; stop it before
 * bb_stream_destroy.
 */
#ifndef BB_RENDER_STREAM_IO_H
#define BB_RENDER_STREAM_IO_H

#include "render/stream/stream.h"

struct bb_stream_io;
BB_MUST_CHECK enum bb_status bb_stream_io_start(struct bb_stream *s, struct bb_stream_io **out);
/* Waits until everything asked for has been read; the next frame (or stop) may draw it. For pictures and tests. */
void bb_stream_io_drain(struct bb_stream_io *io);
/* Held, the thread begins no read: a disk that has stalled, for tests. */
void bb_stream_io_hold(struct bb_stream_io *io, bool held);
/* Reads what is still asked for, ends the thread and gives the stream back to reading at once. NULL is allowed. */
void bb_stream_io_stop(struct bb_stream_io *io);

struct bb_stream_disk;
/* ns for each brick and for each of its bytes; both 0 is as good as reading at once. */
BB_MUST_CHECK enum bb_status bb_stream_disk_start(struct bb_stream *s, double read_ns, double byte_ns,
						  struct bb_stream_disk **out);
/* From now on; what is on its way waits. */
void bb_stream_disk_stall(struct bb_stream_disk *d, bool stalled, int64_t now_ns);
void bb_stream_disk_stop(struct bb_stream_disk *d); /* NULL is allowed */

#endif
