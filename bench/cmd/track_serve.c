/*
 * bench/cmd/track_serve.c: `track serve`: poses over NatNet and VRPN without a room: of a viewer who walks a path, or out
 * of a recording. Loopback; until a signal, or --for so long, or the recording is over. docs/streaming.md.
 */
#include <errno.h>
#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/signalfd.h>
#include <unistd.h>

#include "bench/cli.h"
#include "bench/track_record/record.h"
#include "bench/track_record/streaming.h"
#include "hal/scene.h"

#define WAIT_MOST_NS (BB_NS_PER_S / 5)

struct serve {
	const struct bb_cli *cli;
	struct bb_clock *clk;
	struct bb_mocap *mocap;
	struct bb_mocap_config config;
	struct mocap_frame frame; /* the next one */
	int64_t next_ns;          /* when */
	/* either */
	struct bb_room *room;
	struct bb_path *path;     /* NULL: the viewer stands still */
	double rate_hz;
	/* or */
	const char *recording;
	struct bb_record_reader *reader;
	double speed;
	int64_t first_ns, begun_ns; /* the recording's first solve, and when it was played */
	bool begun;
	struct bb_record_item held; /* read already: what ends a frame begins the next */
};

/* ---- a viewer on a path ---- */

static void walk(struct serve *s)
{
	const int64_t now_ns = bb_rate_frame_ns((struct bb_rate){ (uint32_t)lround(s->rate_hz * 1000), 1000 }, s->frame.number);
	const int64_t lap_ns = s->path ? bb_path_duration_ns(s->path) : 0;
	const struct bb_pose eyes = s->path ? bb_path_at(s->path, lap_ns > 0 ? now_ns % lap_ns : 0)
	                                    : (struct bb_pose){ s->room->neutral, BB_QUAT_IDENTITY };
	const struct bb_vec3 eye = bb_quat_rotate(eyes.q, s->room->bodies[0].eye_centre);

	s->next_ns = s->begun_ns + now_ns;
	s->frame.mid_exposure_ns = s->frame.received_ns = s->next_ns;
	s->frame.body[0] = (struct mocap_pose){ .valid = true, .pose = { bb_vec3_sub(eyes.p, eye), eyes.q } };
}

/* ---- a recording ---- */

static enum bb_status open_recording(struct serve *s, struct bb_error *err)
{
	bb_record_close(s->reader);
	s->reader = NULL;
	s->begun = false;
	const enum bb_status status = bb_record_open(s->recording, &s->reader, err);
	s->held.kind = BB_RECORD_PAD; /* of no interest here */
	return status;
}

static void keep(struct serve *s, const struct bb_record_pose *p)
{
	struct mocap_pose *b = &s->frame.body[p->body];

	b->valid = true;
	b->pose = p->solution.body;
	b->error_m = fmin(p->solution.position_sigma_mm * 1e-3, 1e3);
	s->frame.mid_exposure_ns = p->solution.at_ns;
}

/* Poses from one solve to the next are a frame, with none when nobody was seen. BB_SKIPPED: the recording is over. */
static enum bb_status read_frame(struct serve *s, struct bb_error *err)
{
	enum bb_status status = BB_OK;

	for (size_t i = 0; i < MOCAP_BODIES_MAX; i++)
		s->frame.body[i].valid = false;
	while (status == BB_OK && !(s->held.kind == BB_RECORD_SOLVE || s->held.kind == BB_RECORD_END))
		status = bb_record_next(s->reader, &s->held, err);
	if (status != BB_OK || s->held.kind == BB_RECORD_END)
		return status != BB_OK ? status : BB_SKIPPED;
	const int64_t at_ns = s->held.now_ns;
	s->frame.mid_exposure_ns = s->frame.received_ns = at_ns;
	while ((status = bb_record_next(s->reader, &s->held, err)) == BB_OK && s->held.kind != BB_RECORD_SOLVE &&
	       s->held.kind != BB_RECORD_END)
		if (s->held.kind == BB_RECORD_POSE && s->held.pose.body < MOCAP_BODIES_MAX)
			keep(s, &s->held.pose);
	if (status != BB_OK)
		return status;
	if (!s->begun) {
		s->begun = true;
		s->first_ns = at_ns;
		s->begun_ns = bb_clock_now_ns(s->clk);
	}
	const double due_ns = (double)(at_ns - s->first_ns) / (s->speed > 0 ? s->speed : 1e9);
	s->next_ns = s->begun_ns + (int64_t)fmin(fmax(due_ns, 0), 9e17);
	return BB_OK;
}

/* The next frame; BB_SKIPPED: there is none. */
static enum bb_status advance(struct serve *s, struct bb_error *err)
{
	enum bb_status status = BB_OK;

	if (!s->recording) {
		walk(s);
		s->frame.number++;
		return BB_OK;
	}
	status = read_frame(s, err);
	if (status == BB_SKIPPED && bb_cli_has(s->cli, "repeat") && s->begun) {
		status = open_recording(s, err);
		if (status == BB_OK)
			status = read_frame(s, err);
	}
	s->frame.number++;
	return status;
}

/* ---- the loop ---- */

static enum bb_status serve_until(struct serve *s, int signal_fd, int64_t end_ns, struct bb_error *err)
{
	struct signalfd_siginfo told;
	enum bb_status status = advance(s, err);

	while (status == BB_OK) {
		int64_t now_ns = bb_clock_now_ns(s->clk);
		const int64_t due_ns = s->next_ns < end_ns ? s->next_ns : end_ns;
		const int64_t wait_ns = due_ns - now_ns < WAIT_MOST_NS ? due_ns - now_ns : WAIT_MOST_NS;
		if (bb_mocap_wait(s->mocap, wait_ns > 0 ? wait_ns : 0, signal_fd) && read(signal_fd, &told, sizeof(told)) > 0)
			return BB_OK;
		now_ns = bb_clock_now_ns(s->clk);
		bb_mocap_step(s->mocap, now_ns);
		if (now_ns >= end_ns)
			return BB_OK;
		if (now_ns < s->next_ns)
			continue;
		bb_mocap_frame(s->mocap, &s->frame, now_ns);
		status = advance(s, err);
	}
	return status == BB_SKIPPED ? BB_OK : status;
}

/* ---- set-up ---- */

static enum bb_status set_up_room(struct serve *s, struct bb_error *err)
{
	const char *path = bb_cli_get(s->cli, "path", NULL);
	enum bb_status status;

	if (!s->cli->n_args)
		return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "track serve wants a ROOM or --replay FILE");
	status = bb_room_load(s->cli->arg[0], &s->room, err);
	if (status == BB_OK && !s->room->n_bodies)
		status = bb_fail(err, BB_ERR_CONFIG, 1766, NULL, "%s has no bodies", s->cli->arg[0]);
	if (status == BB_OK && path)
		status = bb_path_load(path, &s->path, err);
	if (status == BB_OK) /* the viewer wears the glasses; other bodies are in nobody's hand */
		bb_streaming_model(&s->config.model, s->room->bodies, 1, s->rate_hz);
	return status;
}

static enum bb_status set_up_recording(struct serve *s, struct bb_error *err)
{
	const enum bb_status status = open_recording(s, err);

	if (status != BB_OK)
		return status;
	if (s->cli->n_args || bb_cli_has(s->cli, "path"))
		return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "--replay needs neither a ROOM nor a --path");
	const struct bb_record_head *h = bb_record_head(s->reader);
	bb_streaming_model(&s->config.model, h->body, h->n_bodies, s->rate_hz);
	s->frame.recorded = true;
	return BB_OK;
}

static enum bb_status set_up(struct serve *s, double *for_s, struct bb_error *err)
{
	enum bb_status status = bb_cli_number(s->cli, "for", 0, 0.01, 1e9, for_s, err);

	s->recording = bb_cli_get(s->cli, "replay", NULL);
	if (status == BB_OK)
		status = bb_cli_number(s->cli, "rate", 120, 1, 1000, &s->rate_hz, err);
	if (status == BB_OK)
		status = bb_cli_number(s->cli, "speed", 1, 0, 1000, &s->speed, err);
	if (status == BB_OK)
		status = bb_streaming_read(s->cli, bb_cli_get(s->cli, "stream", NULL), &s->config, err);
	if (status == BB_OK)
		status = bb_clock_posix_create(&s->clk);
	if (status == BB_OK)
		status = s->recording ? set_up_recording(s, err) : set_up_room(s, err);
	if (status == BB_OK)
		status = bb_mocap_open(&s->config, &s->mocap, err);
	return status;
}

static void print_counts(const struct serve *s)
{
	const struct bb_mocap_counts n = bb_mocap_counts(s->mocap);

	fprintf(stderr, "%llu frames; NatNet: %llu datagrams sent, %llu heard, %llu refused; VRPN: %llu poses, %llu dropped, %llu "
	        "connections, %llu refused\n", (unsigned long long)n.frames, (unsigned long long)n.natnet_sent,
	        (unsigned long long)n.natnet_heard, (unsigned long long)n.natnet_refused, (unsigned long long)n.vrpn_poses,
	        (unsigned long long)n.vrpn_dropped, (unsigned long long)n.vrpn_connections,
	        (unsigned long long)n.vrpn_refused);
}

static enum bb_status serve(struct serve *s, struct bb_error *err)
{
	double for_s = 0;
	enum bb_status status = set_up(s, &for_s, err);

	if (status != BB_OK)
		return status;
	const int fd = bb_cli_signals();
	if (fd < 0)
		return bb_fail(err, BB_ERR_INTERNAL, 1760, NULL, "no signalfd: %s", strerror(errno));
	if (bb_cli_has(s->cli, "json")) {
		(void)bb_cli_print_json(bb_streaming_json(s->mocap, &s->config));
		fflush(stdout);
	} else {
		bb_streaming_print(s->mocap, &s->config, stdout);
	}
	s->begun_ns = bb_clock_now_ns(s->clk);
	status = serve_until(s, fd, for_s > 0 ? s->begun_ns + (int64_t)(for_s * 1e9) : BB_NEVER, err);
	print_counts(s);
	close(fd);
	return status;
}

static int command(const struct bb_cli *cli)
{
	struct serve *s = calloc(1, sizeof(*s));
	struct bb_error err = { 0 };

	if (!s)
		return bb_cli_fail(bb_fail(&err, BB_ERR_NOMEM, 1702, NULL, "track serve"), &err);
	s->cli = cli;
	const enum bb_status status = serve(s, &err);
	bb_mocap_close(s->mocap);
	bb_record_close(s->reader);
	bb_path_free(s->path);
	bb_room_free(s->room);
	bb_clock_destroy(s->clk);
	free(s);
	return status == BB_OK ? BB_EXIT_OK : bb_cli_fail(status, &err);
}

static const struct bb_cli_option options[] = {
	{ "replay", "FILE", "the poses of a recording, instead of a viewer in ROOM" },
	{ "repeat", NULL, "that recording again and again" },
	{ "speed", "N", "of the recording: 1 as it was (default), 0 as fast as it goes" },
	{ "path", "FILE", "where the viewer walks, again and again; without it he stands" },
	{ "rate", "HZ", "frames a second of the viewer (120)" },
	{ "stream", "LIST", "natnet[:COMMAND[:DATA]],vrpn[:PORT], ports 1510, 1511, 3883; 0: any free one" },
	{ "bind", "ADDRESS", "listen there instead of 127.0.0.1; not loopback: only with --allow" },
	{ "allow", "ADDRESS", "who may connect from outside; may be repeated" },
	{ "multicast", "ADDRESS", "NatNet frames to 239.255.42.99, out of the interface with this address" },
	{ "for", "S", "end after so many seconds instead of at a signal" },
	{ "json", NULL, "machine-readable" },
	{ NULL, NULL, NULL },
};

const struct bb_command bb_cmd_track_serve = {
	"track serve",
	"poses of a simulated viewer, or of a recording, over NatNet and VRPN",
	"ROOM|--replay FILE [--path FILE] [--rate HZ] [--stream LIST] [--bind ADDRESS --allow ADDRESS]... [--for S] [--json]",
	options,
	0,
	1,
	command,
};
