/*
 * bench/run.h: one run = room x scene x seed, from bring-up to verdict. The steps are rig (open what the scene needs),
 * loop (design section 5, frame by frame), judge, pictures. Everything a run depends on is in struct bb_run_options.
 */
#ifndef BB_BENCH_RUN_H
#define BB_BENCH_RUN_H

#include <signal.h>

#include "bench/result.h"
#include "drivers/mocap/mocap_port.h"
#include "hal/eventlog.h"
#include "sim/faults.h"

/* One run in several processes (bench/nodes/nodes.h); n 0 or 1: in this one. */
struct bb_run_processes {
	uint16_t n, process;        /* how many; which this is: 0 the head's, BB_LINK_ANY whichever is free */
	const char *link;           /* URI of the link: the head listens there, the others join there */
	const char *token_file;     /* NULL: the head makes a secret for those it starts itself */
	bool wait;                  /* the others are started by somebody else */
	bool open;                  /* the link may listen on an address that is not loopback */
	bool restart;               /* a process that dies is started again */
	bool tell;                  /* on standard error, when all are there */
};

struct bb_run_options {
	const char *room_path, *scene_path;
	uint64_t seed;
	bool posix_clock;
	const char *gl;             /* "auto", "osmesa", "egl" */
	const char *out_dir;        /* NULL: no files, no pictures */
	bool pictures;              /* draw the frames the scene asks for (virtual clock) */
	bool measure_psnr;
	const struct sim_fault *faults;
	size_t n_faults;
	double duration_s;          /* 0: the scene's */
	int fidelity[BB_CLASS_COUNT]; /* override of needs; -2: as the scene says */
	double memory_mib;          /* override; < 0: as the scene says */
	int64_t stream_bricks;      /* override; < 0: as the scene says */
	int64_t plant_draw_ns;      /* test of the gate: added to every draw */
	double plant_crystal_ppm;   /* test of bench/loop/follow.h: this process's clock is that much too fast */
	int64_t plant_bricks;       /* test of the gate: extra bricks per frame */
	struct bb_run_processes processes;
	const char *record_path;    /* what the tracker sees and says, into this file; NULL: no */
	const struct bb_mocap_config *stream; /* poses to other programs; the model is the room's; NULL: no */
	bool allow_flash;           /* run what flashes, and do not judge it */
	bool dim_flash;             /* darken a scene that would flash until it does not */
	double dim;                 /* all pictures, 0..1; bb_run sets it when it has to */
	const volatile sig_atomic_t *stop; /* not 0: open the shutters, stop, report what there is; may be NULL */
	void (*events)(void *ctx, const struct bb_event *events, size_t n); /* sees the event log; may be NULL */
	void *events_ctx;
	const struct bb_log *log;
	void (*progress)(void *ctx, double done_0_1, const char *what); /* may be NULL */
	void *progress_ctx;
};
struct bb_run_options bb_run_options_default(void);

struct bb_run { /* owns all that the result borrows */
	struct bb_room *room;
	struct bb_scene *scene;
	struct bb_run_result *result;
};
/* On BB_OK *out is complete whatever the verdict; files are written when out_dir is set. */
BB_MUST_CHECK enum bb_status bb_run(const struct bb_run_options *options, struct bb_run *out, struct bb_error *err);
void bb_run_free(struct bb_run *run);

#endif
