/* bench/nodes/nodes.c: who plays what, the link between them, and who is gone. */
#include "bench/nodes/nodes.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "bench/backends.h"
#include "bench/cli.h"
#include "bench/file.h"
#include "bench/nodes/spawn.h"

#define JOIN_WITHIN_NS (30 * BB_NS_PER_S)
#define END_WITHIN_NS (2 * BB_NS_PER_S)
#define RESTARTS_MOST 3

struct bb_nodes {
	const struct bb_run_options *o;
	struct bb_clock *clk;
	struct bb_link *link;
	struct bb_link_group group;
	char token[BB_TOKEN_MAX];
	struct bb_child child[LINK_PROCESSES_MAX]; /* by process; pid 0: not started here */
	struct bb_node_loss ended[LINK_PROCESSES_MAX]; /* of children that ended and whose loss is not told yet */
	uint32_t lost_joins[LINK_PROCESSES_MAX];   /* the session whose loss was told */
	unsigned restarts;
};

struct bb_link *bb_nodes_link(const struct bb_nodes *n)
{
	return n->link;
}

uint16_t bb_nodes_process(const struct bb_nodes *n)
{
	return n->group.process;
}

uint16_t bb_nodes_count(const struct bb_nodes *n)
{
	return n->group.n_processes;
}

const struct bb_link_group *bb_nodes_group(const struct bb_nodes *n)
{
	return &n->group;
}

uint16_t bb_nodes_home(const struct bb_nodes *n, size_t node)
{
	return n->group.home[node];
}

/* ---- who plays what ---- */

/* The head's node stays with the head; those with screens are dealt out to the others, and so is the rest. */
static void deal(struct bb_link_group *g, const struct bb_room *room)
{
	uint16_t next = 1;

	for (int with_screens = 1; with_screens >= 0; with_screens--)
		for (uint16_t i = 0; i < room->n_nodes; i++) {
			bool has = false;
			for (size_t s = 0; s < room->n_screens; s++)
				has |= room->screens[s].node == i;
			if (room->nodes[i].head || has != with_screens)
				continue;
			g->home[i] = next;
			next = (uint16_t)(next % (g->n_processes - 1) + 1);
		}
}

static void hash_config(const struct bb_run_options *o, const struct bb_room *room, const struct bb_scene *scene,
                        uint8_t out[32])
{
	char text[256];
	struct bb_hash h;

	snprintf(text, sizeof(text), "%llu %u %.9g %.9g %lld %s", (unsigned long long)o->seed, o->processes.n,
	         scene->duration_s, o->memory_mib, (long long)o->stream_bricks, o->gl);
	memset(out, 0, 32);
	if (!bb_hash_init(&h))
		return;
	bb_hash_update(&h, room->sha256, sizeof(room->sha256));
	bb_hash_update(&h, scene->sha256, sizeof(scene->sha256));
	bb_hash_update(&h, text, strlen(text));
	bb_hash_final(&h, out);
}

static enum bb_status take_token(struct bb_nodes *n, struct bb_error *err)
{
	const char *path = n->o->processes.token_file;
	uint8_t random[32];
	char hex[BB_HASH_HEX];

	if (path)
		return bb_token_read(path, n->token, err);
	if (n->o->processes.process || !bb_random_secret(random, sizeof(random)))
		return bb_fail(err, BB_ERR_USAGE, 1671, NULL, "no secret to join with");
	bb_hash_hex(random, hex);
	snprintf(n->token, sizeof(n->token), "%s", hex);
	return BB_OK;
}

/* ---- the link ---- */

static enum bb_status open_link(struct bb_nodes *n, const struct bb_room *room, const struct bb_log *log,
                                struct bb_error *err)
{
	const struct bb_run_processes *p = &n->o->processes;
	struct bb_link_config config = room->link;
	struct bb_open open = { .clk = n->clk, .log = log };
	struct bb_uri uri;
	struct bb_error why = { 0 };

	snprintf(config.device, sizeof(config.device), "%s", p->link);
	config.group = &n->group;
	open.uri = &uri;
	if (bb_uri_parse(config.device, &uri, &(struct bb_where){ 0 }, &why) != BB_OK ||
	    (strcmp(uri.scheme, "shm") && strcmp(uri.scheme, "zmq")))
		return bb_fail(err, BB_ERR_USAGE, 1670, NULL, "'%.100s'", p->link);
	if (p->open && uri.n_options < BB_URI_OPTIONS_MAX) {
		snprintf(uri.option[uri.n_options].key, sizeof(uri.option[0].key), "open");
		snprintf(uri.option[uri.n_options++].value, sizeof(uri.option[0].value), "1");
	}
	const struct bb_backend *backend = bb_backend_find(&uri, "link/net", err);
	const enum bb_status status = backend ? bb_link_open(backend->link, &config, &open, &n->link) : BB_ERR_CONFIG;
	if (status == BB_ERR_REFUSED)
		return bb_fail(err, BB_ERR_USAGE, 1672, NULL, "%.100s", p->link);
	if (status == BB_ERR_BUSY && p->process)
		return bb_fail(err, status, 1675, NULL, "process %u of %u", p->process, p->n);
	if (status != BB_OK)
		return bb_fail(err, status, p->process ? 1674 : 1673, NULL, "%.100s: %s", p->link, bb_status_text(status));
	return BB_OK;
}

static enum bb_status refused(const struct bb_nodes *n, struct bb_error *err)
{
	switch (link_refusal(n->link)) {
	case LINK_OTHER_VERSION:
		return bb_fail(err, BB_ERR_CONFIG, 1676, NULL, "this one is %s", bb_revision());
	case LINK_OTHER_CONFIG:
		return bb_fail(err, BB_ERR_CONFIG, 1677, NULL, "the head does not know this room, scene or option");
	default:
		return bb_fail(err, BB_ERR_BUSY, 1675, NULL, "every place of %u is taken", n->o->processes.n);
	}
}

static enum bb_status join(struct bb_nodes *n, struct bb_error *err)
{
	const int64_t start_ns = bb_clock_now_ns(n->clk);
	int64_t uncertainty_ns;
	enum bb_status status;

	while ((status = link_joined(n->link)) == BB_TIMEOUT && bb_clock_now_ns(n->clk) - start_ns < JOIN_WITHIN_NS)
		bb_clock_run_until(n->clk, bb_clock_now_ns(n->clk) + BB_NS_PER_S / 100);
	if (status == BB_ERR_REFUSED)
		return refused(n, err);
	if (status != BB_OK)
		return bb_fail(err, BB_ERR_LOST, 1674, NULL, "%.100s: nobody answers", n->o->processes.link);
	n->group.process = link_process(n->link);
	bb_clock_set_zero(n->clk, link_head_zero_ns(n->link, &uncertainty_ns));
	bb_clock_plant_crystal(n->clk, n->o->plant_crystal_ppm * 1e3);
	return BB_OK;
}

/* ---- the others ---- */

static enum bb_status start_child(struct bb_nodes *n, uint16_t process, struct bb_error *err)
{
	const struct bb_run_options *o = n->o;
	char number[6][32];
	const char *argv[40] = { "blackburst", "node", o->room_path, o->scene_path, "--join", link_address(n->link),
		                 "--token-file", "-", "--gl", o->gl };
	size_t a = 10;

	snprintf(number[0], sizeof(number[0]), "%u", process);
	snprintf(number[1], sizeof(number[1]), "%u", o->processes.n);
	snprintf(number[2], sizeof(number[2]), "%llu", (unsigned long long)o->seed);
	snprintf(number[3], sizeof(number[3]), "%.9g", o->duration_s);
	snprintf(number[4], sizeof(number[4]), "%.9g", o->memory_mib);
	snprintf(number[5], sizeof(number[5]), "%lld", (long long)o->stream_bricks);
	static const char *const option[] = { "--index", "--nodes", "--seed", "--duration", "--memory-mib", "--stream-bricks" };
	for (size_t i = 0; i < BB_ARRAY_LEN(option); i++) {
		if ((i == 3 && o->duration_s <= 0) || (i == 4 && o->memory_mib < 0) || (i == 5 && o->stream_bricks < 0))
			continue;
		argv[a++] = option[i];
		argv[a++] = number[i];
	}
	if (!bb_child_start(&n->child[process], argv, n->token))
		return bb_fail(err, BB_ERR_IO, 1678, NULL, "process %u", process);
	return BB_OK;
}

static enum bb_status start_children(struct bb_nodes *n, struct bb_error *err)
{
	enum bb_status status = BB_OK;

	for (uint16_t i = 1; i < n->group.n_processes && status == BB_OK; i++)
		status = start_child(n, i, err);
	return status;
}

/* A child that ended is remembered with how; its session ends with it. */
static void reap(struct bb_nodes *n)
{
	for (uint16_t i = 1; i < n->group.n_processes; i++) {
		struct bb_error unused = { 0 };
		char how[80];
		if (!n->child[i].pid || !bb_child_ended(&n->child[i], how, sizeof(how)))
			continue;
		n->ended[i].process = i;
		snprintf(n->ended[i].what, sizeof(n->ended[i].what), "process %u (pid %d) %s", i, n->child[i].last_pid, how);
		if (n->o->processes.restart && n->restarts++ < RESTARTS_MOST && start_child(n, i, &unused) != BB_OK)
			n->child[i].pid = 0;
	}
}

bool bb_nodes_lost(struct bb_nodes *n, struct bb_node_loss *out)
{
	reap(n);
	link_look_after(n->link);
	for (uint16_t i = 1; i < n->group.n_processes; i++) {
		const struct link_peer peer = link_peer(n->link, i);
		if (n->ended[i].process) {
			*out = n->ended[i];
			n->ended[i].process = 0;
			n->lost_joins[i] = peer.joins;
			return true;
		}
		/* The exit status of a child comes in a moment and says more. */
		if (peer.state != LINK_PEER_LOST || n->lost_joins[i] == peer.joins || n->child[i].pid)
			continue;
		n->lost_joins[i] = peer.joins;
		out->process = i;
		snprintf(out->what, sizeof(out->what), "process %u (pid %u) %s", i, peer.pid,
		         peer.left ? "left" : "is gone: its link broke");
		return true;
	}
	return false;
}

/* ---- open and close ---- */

enum bb_status bb_nodes_open(const struct bb_run_options *o, const struct bb_room *room, const struct bb_scene *scene,
                             struct bb_clock *clk, const struct bb_log *log, struct bb_nodes **out, struct bb_error *err)
{
	struct bb_nodes *n = calloc(1, sizeof(*n));
	enum bb_status status;

	*out = n;
	if (!n)
		return bb_fail(err, BB_ERR_NOMEM, 1702, NULL, "the processes");
	if (o->processes.n > room->n_nodes)
		return bb_fail(err, BB_ERR_USAGE, 1701, NULL, "%u processes for %zu nodes", o->processes.n, room->n_nodes);
	n->o = o;
	n->clk = clk;
	n->group.process = o->processes.process;
	n->group.n_processes = o->processes.n;
	deal(&n->group, room);
	hash_config(o, room, scene, n->group.config_sha256);
	bb_hash_bytes(bb_revision(), strlen(bb_revision()), n->group.version_sha256);
	status = take_token(n, err);
	bb_hash_bytes(n->token, strlen(n->token), n->group.secret);
	if (status == BB_OK)
		status = open_link(n, room, log, err);
	if (status == BB_OK && n->group.process)
		return join(n, err);
	if (status == BB_OK && o->processes.wait)
		fprintf(stderr, "waiting for %d processes: blackburst node %s %s --nodes %u --join %s --token-file FILE\n",
		        o->processes.n - 1, o->room_path, o->scene_path, o->processes.n, link_address(n->link));
	else if (status == BB_OK)
		status = start_children(n, err);
	return status;
}

void bb_nodes_close(struct bb_nodes *n)
{
	if (!n)
		return;
	const int64_t end_ns = bb_clock_stopwatch_ns() + END_WITHIN_NS;
	bb_link_close(n->link); /* says good-bye, and they end */
	n->link = NULL;
	for (uint16_t i = 1; i < n->group.n_processes; i++)
		bb_child_end(&n->child[i], n->clk, end_ns);
	memset(n->token, 0, sizeof(n->token));
	free(n);
}
