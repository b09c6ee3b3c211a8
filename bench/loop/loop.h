/*
 * bench/loop.h: the frame loop of design section 5, as state machines on the injected clock.
 *
 *   head.c    begins a frame at the master display's vblank: cameras -> tracker -> pose at photon time; gamepads ->
 *             navigation; scene state to every node; swap barrier; release.
 *   node.c    on scene state: select, stream, draw (or cost the drawing); arrive; on release: present.
 *   streaming.c  what every node asked of its disk and what that cost its frames.
 *   orphan.c  what a node does while it hears nothing of the head: hold, fade, wait in the dark.
 *   frames.c  what each frame did, closed into the ledger when its last flip is known.
 *   tracking.c  camera frames -> tracker; cameras.c watches over every camera; pose.c makes its pose the pictures'.
 *   shutters.c, eyes of the room: edges -> phase, polarity.
 *   eyes.c    what the eyes are let see: shutters open or running, stereo or mono, faded; light.c how bright that is.
 *
 * Head and nodes talk only through the link. Nothing here allocates after bb_loop_create. One thread.
 */
#ifndef BB_BENCH_LOOP_H
#define BB_BENCH_LOOP_H

#include "hal/profile.h"
#include "render/stream/io.h"
#include "bench/blackbox.h"
#include "bench/ledger.h"
#include "bench/loop/crosstalk.h"
#include "bench/loop/diode.h"
#include "bench/loop/light.h"
#include "bench/pictures.h"
#include "bench/rig.h"
#include "bench/run.h"
#include "bench/watch.h"
#include "sim/world.h"
#include "sync/barrier.h"
#include "sync/calibrate/drift.h"
#include "sync/framelock/straggler.h"
#include "sync/phase.h"
#include "sync/polarity.h"
#include "sync/sync_guard.h"
#include "sync/track/gesture.h"
#include "sync/track/steady.h"

#define BB_AHEAD 4 /* steps of the data that are planned for */
#define BB_FRAMES_RING 8
#define BB_NODES_MAX 64
#define BB_NOBODY 0xFFFF
#define VBLANK_GUARD_NS 20000 /* what must come after an expected vblank comes this long after it */

struct bb_node_times {
	int64_t received_ns, selected_ns, ready_ns, released_ns; /* 0: did not happen */
};

struct bb_frame {
	uint64_t frame;
	bool open;
	int64_t start_ns, photon_ns;      /* begin at the head; the photon time the pose was predicted for */
	int64_t mid_exposure_ns, exposed_ns, readout_end_ns, arrived_ns; /* of the newest camera frame used; 0: none */
	int64_t read_ns, solved_ns, tracked_ns; /* the cameras are read; their blobs solved; the state goes out */
	struct bb_pose eyes, unpredicted; /* for photon_ns; as the newest solution left them */
	int64_t solved_at_ns;             /* mid-exposure of that solution */
	double pose_sigma_mm, solved_sigma_mm;
	enum bb_steady_state pose_state;
	unsigned track_flags;
	uint32_t cameras;
	double pose_error_mm;
	struct bb_node_times node[BB_NODES_MAX];
	int64_t release_ns;               /* at the head */
	unsigned last_node;               /* came last to the barrier, or not at all */
	bool late;                        /* released after the vblank it was meant for */
	uint64_t missing_nodes;           /* bits */
	uint32_t n_flips, late_flips;
	int64_t first_flip_ns, last_flip_ns, flip_ns; /* flip_ns: of the first screen */
	uint16_t last_flip_screen, late_screen, swapped_screen;
	bool eyes_swapped, mono;
	int64_t lamp_ns;                  /* the lamp of the latency self-test lit up last, as far as its cameras saw */
	uint32_t bricks_wanted, bricks_missing, bricks_loaded;
	uint64_t bytes, deficit;
	int64_t load_ns;                  /* the most a node spent on bricks */
	unsigned view_flags;
};

struct bb_frame_loop;
struct bb_labels;
struct bb_loop_lock;
struct bb_follow;
struct bb_nodes;

struct bb_pad { /* one gamepad */
	struct bb_pad_report report;      /* newest */
	bool seen, gone;
	int64_t let_go_ns;                /* since when it is silent or gone; 0: it is not */
	float held[BB_PAD_AXES];          /* where each axis stands, and since when */
	int64_t held_ns[BB_PAD_AXES];
	uint32_t stuck;                   /* bit i: axis i has been told of, */
	size_t stuck_warning[BB_PAD_AXES]; /* by this */
	bool drift_told, battery_told;
};

enum bb_camera_trouble {
	BB_CAMERA_FRAMES,  /* lost, or gone with it */
	BB_CAMERA_SIGHT, BB_CAMERA_FLOOD, BB_CAMERA_PLACE, BB_CAMERA_TRIGGER,
	BB_CAMERA_TROUBLES
};

struct bb_camera_watch { /* cameras.c: one camera */
	size_t slot[BB_CAMERA_TROUBLES];  /* all "camera/<id>" */
	unsigned good[BB_CAMERA_TROUBLES]; /* frames in a row without it */
	uint32_t seq;
	int64_t seen_ns;                  /* arrival of the newest frame */
	uint64_t failures;                /* of the device, seen so far */
	double lost_share;                /* of the last frames */
	uint32_t blind, same, unused, astray; /* frames in a row: no blobs though expected; the very same ones; none that the
	                                         tracker could use; away from their place in the sync */
	uint64_t sum, used;
	double drift_px;                  /* the most of this drift */
	double phase_ns;                  /* that place */
	bool phased;
};

struct bb_eyes { /* eyes.c */
	struct bb_sync_guard guard;
	struct bb_safe_state safe;
	struct bb_safe_output out;        /* of the frame begun last */
	double sent, shown;               /* light of the pictures: of the last frame; on show since it began */
	bool runs, running;               /* the shutters: told with the pictures; told and heard */
	bool gone;                        /* the chain does not answer */
	struct bb_timer watch;            /* for an edge that does not come */
	uint32_t swapped;                 /* by stage: its wall gets the other eye's pictures */
	size_t slot, parity_slot;
};

struct bb_view_cause { /* what a node's views follow from */
	struct bb_pose navigation, eyes;
	uint32_t depth, swapped;
};

/* What head and nodes say to each other, as bytes on the link (one build, one machine: native layout). */
enum bb_message_kind { BB_MESSAGE_STATE = 0x6201, BB_MESSAGE_ARRIVE, BB_MESSAGE_RELEASE,
                       BB_MESSAGE_OVER /* the scene is: nothing more will be heard */ };
struct bb_message {
	uint32_t kind;
	uint32_t swapped;                 /* by stage of the chain: its wall gets the other eye's view */
	uint64_t frame;
	int64_t photon_ns;
	int64_t silence_ns;               /* how long the head may not be heard of from here on */
	struct bb_pose eyes, navigation;
	double scene_s, steps, ahead[BB_AHEAD];
	int16_t way;
	uint16_t quality;                 /* of the draw */
	uint16_t depth, light;            /* 0 .. BB_WHOLE, as quality: the eyes' distance and the pictures' brightness, of their own */
};
#define BB_WHOLE 65535

struct bb_orphan { /* orphan.c: a node and whether it hears of the head */
	struct bb_timer watch;
	struct bb_safe_state safe;
	struct bb_message last;           /* the newest state */
	int64_t heard_ns;
	double light;                     /* of this node's walls, beside what the head asks for */
	bool alone;
	uint64_t pictured;                /* newest frame + 1 whose pictures were taken without the head */
	size_t slot;
};

struct bb_node_machine { /* one node of the room */
	struct bb_frame_loop *loop;
	uint16_t index;
	size_t n_screens;
	uint16_t *screens;                /* indices into room->screens */
	struct bb_profile profile;
	struct bb_stream *stream;
	struct bb_stream_io *io;          /* posix: its reader */
	struct bb_stream_disk *disk;      /* virtual: the model of one */
	int64_t draw_ns;                  /* of the last frame, without what was uploaded */
	struct bb_stream_counts counts;   /* of the frame being drawn, */
	int64_t load_ns;                  /* and what it spends on its bricks */
	uint64_t held_bytes;              /* played elsewhere: what its process told of its memory */
	uint64_t waiting;                 /* bricks asked for and not here, */
	int64_t arrived_ns;               /* and when one came last, or the first of them was asked for */
	size_t stall;                     /* 1 + the warning that none come; 0: none */
	bool failure_told;
	struct bb_view *views;            /* n_screens x eyes */
	size_t n_views;
	struct bb_view_cause made_for;    /* what the views were made for */
	bool made;
	unsigned view_flags;
	struct bb_timer inbox, ready, hold;
	struct bb_orphan orphan;
	double quality;                   /* of a draw: samples, as a share of the scene's */
	size_t coarse;                    /* 1 + the warning that it is less than all; 0: none */
	uint32_t *target;                 /* by screen: vblank its last image was presented for */
	uint64_t frame;                   /* being drawn */
	uint16_t source;                  /* in the event log */
};

struct bb_frame_loop {
	const struct bb_run_options *options;
	const struct bb_room *room;
	const struct bb_scene *scene;
	struct bb_clock *clk;
	struct bb_eventlog *events;
	struct bb_rig *rig;
	struct sim_world *world;          /* NULL without sims */
	struct bb_ledger *ledger;
	struct bb_run_result *result;     /* counters, facts, path */
	struct bb_watch *watch;
	struct bb_blackbox *blackbox;     /* NULL: none */
	struct bb_tracker *tracker;       /* NULL: cameras not needed */
	struct bb_drift *drift;           /* with it, */
	struct bb_labels *labels;         /* and these */
	size_t swap_slot;                 /* "tracker/<body>" once more */
	struct bb_steady steady;
	size_t pose_slot;                 /* "tracker/<body>" */
	int64_t pose_ns;                  /* of the newest solution */
	struct bb_seeing *seeing;         /* NULL: no camera delivers pictures */
	struct bb_outlets *outlets;       /* bench/loop/outlets.h; NULL: nobody listens and nothing is recorded */
	struct bb_phase phase;
	struct bb_polarity polarity;
	struct bb_crosstalk *crosstalk;   /* NULL: below fidelity 2 */
	struct bb_diode *diode;           /* NULL: no latency self-test */
	struct bb_eyes eyes;
	struct bb_light *light;           /* NULL: displays not needed */
	struct bb_barrier barrier;
	struct bb_straggler straggler;
	struct bb_loop_lock *lock;        /* bench/loop/lock.h; NULL: the head keeps the barrier */
	uint16_t barrier_source;          /* in the event log; 0: not asked yet */
	struct bb_pictures *pictures;     /* NULL: none wanted */
	struct bb_renderer *renderer;     /* posix: every frame; virtual: pictures only */
	const struct bb_bricks *bricks;
	const struct bb_transfer *transfer;
	bool draw_everything;             /* posix */
	bool picture_frame;               /* this frame's pictures are wanted */
	struct bb_image canvas;           /* posix: drawn into, grown to the largest screen at creation */

	struct bb_pose start;             /* of the eyes, when the scene begins */
	struct bb_rate frame_rate;        /* of the loop: refresh, or half of it when frame-sequential */
	int64_t frame_ns, refresh_ns;     /* a frame may be two refreshes long */
	unsigned n_eyes;
	int master_screen;                /* -1: paced by the clock alone */
	uint64_t drawing_nodes;           /* bits */
	struct bb_node_machine *nodes;    /* by room node */

	struct bb_nodes *processes;       /* NULL: all nodes are played in this process */
	struct bb_follow *follow;         /* bench/loop/follow.h; NULL: one process */
	uint64_t ready_processes;         /* bits */
	size_t gone_slot[BB_NODES_MAX];   /* "node/<id>" once more: late is one thing, dead another */
	struct bb_timer beat, look_after; /* bench/loop/remote.c */
	int64_t late_ns, left_ns;         /* the latest beat; when the left eye of the frame under way should see it */
	int64_t usual_ns;                 /* what the slowest node took lately, falling by an eighth a frame; 0: not known */

	struct bb_timer begin, send, head_inbox, deadline;
	int64_t scene_start_ns, end_ns;
	double patch_s;                   /* time of the scene the patch goes by: of the frame begun last */
	uint64_t n_frames;                /* begun */
	struct bb_frame frames[BB_FRAMES_RING];
	uint64_t closed;                  /* frames below this are closed */
	struct bb_pose navigation;        /* room to world */
	double steps, ahead[BB_AHEAD];    /* time in the data: now, and in so many times seconds_per_step */
	int32_t way;                      /* it goes on, back, or stands still */

	struct bb_timemap *camera_map;    /* by camera */
	uint64_t *flipped;                /* by screen: bit frame % 64, set when it showed that frame */
	struct bb_camera_watch *cameras;  /* by camera */
	int64_t due_ns;                   /* when the next frame was to begin */
	int64_t turn_ns;                  /* when the devices were read last */
	int64_t wall_ahead_ns;            /* of this process's time, once */
	bool wall_known;
	bool was_away;                    /* drawing kept the loop from reading for so long that queues ran over */
	size_t *gamepad_slot, *node_slot, *display_slot;
	struct bb_pad *pads;              /* by gamepad */
	int64_t pad_read_ns;
	size_t shutter_slot, polarity_slot, rhythm_slot; /* all "shutter/<chain>": each can fail on its own */
	uint64_t doubled_seen;
	struct camera_read *reads;        /* tracking.c: frames read in this turn */
	struct bb_blob *blobs;
	size_t path_cap;
};

BB_MUST_CHECK enum bb_status bb_loop_create(struct bb_frame_loop *loop, struct bb_error *err);
void bb_loop_destroy(struct bb_frame_loop *loop);
struct bb_tracker_config bb_loop_tracker_config(const struct bb_frame_loop *loop);
/* Runs the scene from now on; returns when it is over. */
BB_MUST_CHECK enum bb_status bb_loop_run(struct bb_frame_loop *loop, struct bb_error *err);

/* Between the loop's files. */
struct bb_frame *bb_loop_frame(struct bb_frame_loop *l, uint64_t frame); /* NULL once closed */
unsigned bb_loop_head(const struct bb_frame_loop *l);
/* A message over the link; to itself a node speaks directly. */
void bb_loop_say(struct bb_frame_loop *l, unsigned from, unsigned to, const struct bb_message *m);
void bb_loop_path_point(struct bb_frame_loop *l, int64_t at_ns, const struct bb_vec3 *truth, const struct bb_vec3 *tracked);
/* Time in the data, in steps, at a time of the scene. */
double bb_loop_steps_at(const struct bb_scene *scene, uint32_t n_steps, double t_s);
struct bb_placement bb_loop_placement(const struct bb_scene *scene, const struct bb_bricks *bricks);
int64_t bb_loop_middle_ns(const struct bb_frame_loop *l, size_t screen); /* after its vblank */
struct bb_image *bb_loop_canvas(struct bb_frame_loop *l, const struct bb_screen *screen);
int64_t bb_loop_barrier_timeout_ns(const struct bb_frame_loop *l);
int64_t bb_loop_silence_ns(const struct bb_frame_loop *l); /* nodes that hear nothing of the head for so long are without it */
bool bb_loop_interrupted(const struct bb_frame_loop *l);
bool bb_head_stopped(struct bb_frame_loop *l, int64_t now_ns); /* true: somebody wants it to end, and its shutters are open */
/* Releases the barrier when all that are waited for are there, or the time is over. */
void bb_head_step_barrier(struct bb_frame_loop *l, int64_t now_ns);
/* The head's part of a release: who was late, of those that were waited for (bits); then the next frame. */
void bb_head_note_release(struct bb_frame_loop *l, const struct bb_release *r, uint64_t waited, int64_t now_ns);
void bb_head_begin_next(struct bb_frame_loop *l, int64_t now_ns);
void bb_head_hear(struct bb_frame_loop *l, unsigned from, const struct bb_message *m, int64_t now_ns);
void bb_node_hear(struct bb_node_machine *n, const struct bb_message *m, int64_t now_ns);
int64_t bb_head_next_begin_ns(const struct bb_frame_loop *l, int64_t now_ns);
int64_t bb_head_begin(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns);
int64_t bb_head_send(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns);
int64_t bb_head_inbox(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns);
int64_t bb_head_deadline(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns);
int64_t bb_node_inbox(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns);
void bb_orphan_init(struct bb_node_machine *n);
/* A message of the head's. */
void bb_orphan_heard(struct bb_node_machine *n, const struct bb_message *m, int64_t now_ns);
/* What the node's own light makes of a state, whose pictures are about to be drawn. */
struct bb_message bb_orphan_dim(struct bb_node_machine *n, const struct bb_message *m, int64_t now_ns);
/* Are the walls of all nodes dark, or did they never have a picture? */
bool bb_orphans_rest(const struct bb_frame_loop *l);
/* The newest pictures again, anew at the light of m; or as they are, where the eyes take turns: or both eyes keep the last one's. */
void bb_node_show_again(struct bb_node_machine *n, const struct bb_message *m, bool anew, int64_t now_ns);
void bb_node_take_pictures(struct bb_node_machine *n, const struct bb_message *m);
/* Books what a frame of a node took: its bricks; its time, when it is drawn; a flip of one of its screens. */
void bb_node_book(struct bb_node_machine *n, struct bb_frame *f, const struct bb_stream_counts *c, int64_t now_ns);
void bb_node_drawn(struct bb_node_machine *n, struct bb_frame *f, int64_t ready_ns, int64_t now_ns);
void bb_node_note_flip(struct bb_frame_loop *l, uint16_t screen, const struct bb_flip *flip);
void bb_node_fill(struct bb_node_machine *n);
void bb_node_warm_up(struct bb_node_machine *n);
int64_t bb_node_present(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns);
int64_t bb_node_ready(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns);
void bb_node_flips(struct bb_frame_loop *l, struct bb_node_machine *n);
void bb_streaming_begin(struct bb_frame_loop *l);
void bb_streaming_frame(struct bb_node_machine *n, const struct bb_stream_counts *c, int64_t now_ns);
bool bb_streaming_ready(struct bb_node_machine *n, int64_t received_ns, int64_t ready_ns);
void bb_streaming_gather(const struct bb_frame_loop *l);
void bb_shutters_feed(struct bb_frame_loop *l, int64_t now_ns);
void bb_shutters_read(struct bb_frame_loop *l, struct bb_frame *f, int64_t now_ns);
void bb_eyes_init(struct bb_frame_loop *l);
void bb_eyes_edge(struct bb_frame_loop *l, const struct bb_shutter_edge *e);
void bb_eyes_step(struct bb_frame_loop *l, struct bb_frame *f, int64_t now_ns);
void bb_eyes_gap(struct bb_frame_loop *l, int64_t now_ns);
int64_t bb_eyes_watch(struct bb_timer *timer, int64_t scheduled_ns, int64_t now_ns);
void bb_eyes_open(struct bb_frame_loop *l, int64_t now_ns);
void bb_track_read(struct bb_frame_loop *l, struct bb_frame *f, int64_t now_ns);
void bb_labels_destroy(struct bb_labels *x);
void bb_pose_begin(struct bb_frame_loop *l);
void bb_pose_note(struct bb_frame_loop *l, const struct bb_track_solution *s);
void bb_pose_predict(struct bb_frame_loop *l, struct bb_frame *f, int64_t now_ns);
void bb_pads_read(struct bb_frame_loop *l, int64_t now_ns);
void bb_frames_close(struct bb_frame_loop *l, uint64_t before);

#endif
