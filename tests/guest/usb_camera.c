/*
 * tests/guest/usb_camera.c [REPLUGS [FRAMES]]: the shipped camera driver through libusb, the kernel's USB stack and
 * vhci, against the simulated camera in a process of its own. Measures FRAMES frames, halts its
 * endpoint so that a clear and then a reset is needed, then pulls the plug REPLUGS times and puts the camera back on
 * another port. Prints one JSON line. Exit 0 fine, 1 not, 77 no vhci.
 *
 * Two latencies, in one JSON line. packet_to_frame is from a packet's bytes leaving the simulated camera to the driver's
 * stamp of its arrival. ready_to_user begins when the model has the frame ready and ends with the frame in the caller's
 * hands: it holds what the simulator needs to draw it, and the looks of both, every 100 us. The processes share one
 * monotonic clock, and the model (fidelity 0) stamps mid-exposures with it.
 */
#include "tests/fixture_room.h"

#include <signal.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/wait.h>

#include "drivers/camera_usb.h"
#include "sim/peer_camera.h"
#include "tests/guest/measure.h"
#include "tests/guest/usb_vhci.h"

#define LOOK_NS (100 * US)
#define FRAMES_MOST 6000
#define MSG_UNPLUG 'u'
#define MSG_PLUG 'p'
#define MSG_END 'e'
#define MSG_STALL '1'  /* the endpoint halts once, */
#define MSG_STALLS '3' /* or again after each of two cures: the device has to be reset */

/* The simulator: does what it is told by a byte on a pipe, and answers with one. */

static int64_t *sent_ns; /* shared: when the newest packet left the camera */

struct simulator {
	struct rig rig;
	struct sim_usb_ops ops;
	const struct sim_usb_ops *camera_ops;
	struct usbip_server *server;
	struct peer_camera *peer;
	struct bb_camera *model;
	size_t item;
	unsigned port;
};

static struct simulator *simulated;

static int stamped_in(struct sim_usb_device *dev, uint8_t endpoint, uint8_t *bytes, size_t cap)
{
	const int n = simulated->camera_ops->in(dev, endpoint, bytes, cap);

	if (n > 0)
		*sent_ns = bb_clock_now_ns(simulated->rig.clk);
	return n;
}

static void stamp_packets(struct simulator *s)
{
	struct sim_usb_device *dev = peer_camera_usb(s->peer);

	simulated = s;
	s->camera_ops = dev->ops;
	s->ops = *dev->ops;
	s->ops.in = stamped_in;
	dev->ops = &s->ops;
}

static bool obey(struct simulator *s, char what)
{
	struct sim_usb_device *dev = peer_camera_usb(s->peer);

	if (what == MSG_UNPLUG) {
		usbip_server_withdraw(s->server, s->item);
		return true;
	}
	if (what == MSG_STALL || what == MSG_STALLS) {
		peer_camera_world_stall(s->peer, (uint32_t)(what - '0'));
		return true;
	}
	s->port = (s->port + 1) % 8; /* never the one it was on */
	usbip_server_plug(s->server, s->item, dev);
	return vhci_attach(s->server, s->item, dev, s->port);
}

static int simulate(struct simulator *s, int orders)
{
	const struct peer_camera_options options = { .serial = "GUEST1", .stamped = true };
	const long open_files = descriptors();
	char what = MSG_PLUG;

	fixture_room_init(&s->rig.fix);
	s->rig.fix.cameras[0].sync = BB_SYNC_FREE;
	rig_world(&s->rig, 1, 0);
	s->model = rig_camera(&s->rig, 0);
	if (peer_camera_create(s->model, &options, &s->peer) != BB_OK ||
	    usbip_server_create(s->rig.clk, &s->server) != BB_OK ||
	    usbip_server_export(s->server, peer_camera_usb(s->peer), &s->item) != BB_OK)
		return 1;
	stamp_packets(s);
	while (what != MSG_END) {
		rig_run(&s->rig, LOOK_NS);
		usbip_server_step(s->server, 0);
		if (read(orders, &what, 1) == 1 && what != MSG_END && (!obey(s, what) || write(orders, &what, 1) != 1))
			return 1;
	}
	usbip_server_destroy(s->server);
	peer_camera_destroy(s->peer);
	bb_camera_close(s->model);
	rig_done(&s->rig);
	return descriptors() == open_files ? 0 : 1;
}

/* The room's side */

struct run {
	struct bb_clock *clk;
	struct bb_camera *cam;
	struct bb_camera_frame frame;
	struct bb_blob blobs[BB_CAMERA_BLOBS_MAX];
	int orders;
	uint64_t n, unplugs, replugs, wrong, quarantines;
	int64_t stall_ns, reset_ns;
	long fd_leaked;
	int64_t detect_most_ns, replug_most_ns, open_ns, longest_read_ns;
	int64_t ready_ns[FRAMES_MOST], packet_ns[FRAMES_MOST];
};

static int64_t now(const struct run *r)
{
	return bb_clock_now_ns(r->clk);
}

static bool order(struct run *r, char what)
{
	char answer = 0;

	return write(r->orders, &what, 1) == 1 && read(r->orders, &answer, 1) == 1 && answer == what;
}

static enum bb_status look(struct run *r)
{
	bb_clock_run_until(r->clk, now(r) + LOOK_NS);
	const int64_t begun_ns = now(r);
	const enum bb_status status = bb_camera_read(r->cam, &r->frame);
	const int64_t took_ns = now(r) - begun_ns;
	if (took_ns > r->longest_read_ns)
		r->longest_read_ns = took_ns;
	return status;
}

static bool open_camera(struct run *r, const struct bb_camera_config *config)
{
	static struct bb_uri uri;
	const struct bb_open open = { .clk = r->clk, .uri = &uri, .seed = 1 };
	const int64_t end_ns = now(r) + 10 * BB_NS_PER_S, begun_ns = now(r);

	if (bb_uri_parse("usb:131d:0157?serial=GUEST1&stamps=device", &uri, NULL, NULL) != BB_OK)
		return false;
	while (bb_camera_open(&bb_camera_usb_driver, config, &open, &r->cam) != BB_OK) {
		if (now(r) > end_ns)
			return false;
		bb_clock_run_until(r->clk, now(r) + 20 * MS);
	}
	r->open_ns = now(r) - begun_ns;
	return bb_camera_start(r->cam) == BB_OK;
}

static bool measure(struct run *r, uint64_t frames)
{
	const int64_t end_ns = now(r) + (int64_t)(frames + 60) * 20 * MS;
	const int64_t least_ns = bb_camera_limits(r->cam)->least_latency_ns;

	while (r->n < frames && now(r) < end_ns) {
		const enum bb_status status = look(r);
		if (status == BB_OK) {
			r->packet_ns[r->n] = r->frame.arrived_ns - *sent_ns;
			r->ready_ns[r->n++] = now(r) - (r->frame.mid_exposure.ns + least_ns);
			r->wrong += r->frame.n == 0;
		} else if (status != BB_TIMEOUT)
			return false;
	}
	return r->n == frames;
}

/* Until frames come (or stop coming), three seconds at most. */
static bool until(struct run *r, bool frames, int64_t *took_most_ns)
{
	const int64_t begun_ns = now(r);

	while (now(r) - begun_ns < 3 * BB_NS_PER_S) {
		const enum bb_status status = look(r);
		if (!strcmp(camera_usb_health(r->cam)->fault, "QUARANTINED")) { /* more than five re-opens a minute */
			r->quarantines++;
			(void)!bb_camera_stop(r->cam);
			(void)!bb_camera_start(r->cam);
		}
		if (frames ? status != BB_OK : status != BB_ERR_LOST)
			continue;
		if (now(r) - begun_ns > *took_most_ns)
			*took_most_ns = now(r) - begun_ns;
		return true;
	}
	return false;
}

static bool replug(struct run *r)
{
	const uint32_t seq = r->frame.seq;

	if (!order(r, MSG_UNPLUG) || !until(r, false, &r->detect_most_ns))
		return false;
	r->unplugs++;
	bb_clock_run_until(r->clk, now(r) + 50 * MS);
	if (!order(r, MSG_PLUG) || !until(r, true, &r->replug_most_ns))
		return false;
	r->replugs++;
	r->wrong += r->frame.seq <= seq || strcmp(camera_usb_health(r->cam)->serial, "GUEST1");
	return true;
}

/* From the order to the third good frame after it. */
static bool recover(struct run *r, char what, int64_t *took_ns)
{
	const uint64_t stalls = camera_usb_health(r->cam)->stalls;
	const int64_t begun_ns = now(r);

	if (!order(r, what))
		return false;
	while (now(r) - begun_ns < 3 * BB_NS_PER_S) {
		(void)!look(r);
		*took_ns = now(r) - begun_ns;
		if (camera_usb_health(r->cam)->stalls > stalls && !*camera_usb_health(r->cam)->fault)
			return true;
	}
	return false;
}

static void print_result(struct run *r, uint64_t lost)
{
	const struct camera_usb_health *h = camera_usb_health(r->cam);

	printf("{\"test\":\"usb_camera\",\"frames\":%llu,\"lost\":%llu,\"partial\":%llu,\"bad\":%llu,"
	       "\"read_max_us\":%.1f,\"open_ms\":%.1f,\"stalls\":%llu,\"resets\":%llu,\"stall_ms\":%.1f,"
	       "\"reset_ms\":%.1f,\"unplugs\":%llu,\"replugs\":%llu,\"quarantines\":%llu,\"detect_most_ms\":%.1f,"
	       "\"replug_most_ms\":%.1f,\"wrong\":%llu,\"fd_leaked\":%ld",
	       (unsigned long long)r->n, (unsigned long long)lost, (unsigned long long)h->partial,
	       (unsigned long long)h->bad, (double)r->longest_read_ns * 1e-3, (double)r->open_ns * 1e-6,
	       (unsigned long long)h->stalls, (unsigned long long)h->resets, (double)r->stall_ns * 1e-6,
	       (double)r->reset_ns * 1e-6, (unsigned long long)r->unplugs, (unsigned long long)r->replugs,
	       (unsigned long long)r->quarantines, (double)r->detect_most_ns * 1e-6,
	       (double)r->replug_most_ns * 1e-6, (unsigned long long)r->wrong, r->fd_leaked);
	print_latency("packet_to_frame", r->packet_ns, r->n);
	print_seen("ready_to_user", r->ready_ns, r->n);
	printf("}\n");
}

static int room_side(struct run *r, unsigned long replugs, unsigned long frames)
{
	static struct fixture_room fix;
	bool fine;

	fixture_room_init(&fix);
	fix.cameras[0].sync = BB_SYNC_FREE;
	if (!order(r, MSG_PLUG) || !open_camera(r, &fix.cameras[0])) {
		printf("FAIL: the camera did not come up\n");
		return 1;
	}
	fine = measure(r, frames);
	const uint64_t lost = camera_usb_health(r->cam)->lost;
	fine = fine && recover(r, MSG_STALL, &r->stall_ns) && camera_usb_health(r->cam)->resets == 0;
	fine = fine && recover(r, MSG_STALLS, &r->reset_ns) && camera_usb_health(r->cam)->resets > 0;
	const long open_files = descriptors();
	for (unsigned long i = 0; i < replugs && fine; i++)
		fine = replug(r);
	r->fd_leaked = descriptors() - open_files;
	if (!r->n) {
		printf("FAIL: no frames: %s\n", bb_camera_device(r->cam)->last_error.detail);
		return 1;
	}
	print_result(r, lost);
	fine = fine && !lost && !r->wrong && r->replugs == replugs && r->detect_most_ns <= 100 * MS &&
	       r->fd_leaked <= 1; /* libudev may keep one */
	if (!fine)
		printf("FAIL: %s\n", bb_camera_device(r->cam)->last_error.detail);
	bb_camera_close(r->cam);
	return fine ? 0 : 1;
}

int main(int argc, char **argv)
{
	static struct simulator simulator;
	static struct run run;
	const unsigned long replugs = argc > 1 ? strtoul(argv[1], NULL, 10) : 3;
	const unsigned long frames = argc > 2 ? strtoul(argv[2], NULL, 10) : 600;
	int orders[2];

	if (!vhci_there()) {
		printf("SKIP: no %sattach: modprobe vhci-hcd as root\n", VHCI);
		return 77;
	}
	if (frames < 1 || frames > FRAMES_MOST || socketpair(AF_UNIX, SOCK_STREAM, 0, orders) ||
	    bb_clock_posix_create(&run.clk) != BB_OK)
		return 1;
	sent_ns = mmap(NULL, sizeof(*sent_ns), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
	if (sent_ns == MAP_FAILED)
		return 1;
	const pid_t child = fork();
	if (child == 0) {
		prctl(PR_SET_PDEATHSIG, SIGKILL);
		close(orders[0]);
		fcntl(orders[1], F_SETFL, O_NONBLOCK);
		simulator.rig.clk = run.clk; /* the same zero on both sides */
		_exit(simulate(&simulator, orders[1]));
	}
	close(orders[1]);
	run.orders = orders[0];
	run.frame = (struct bb_camera_frame){ .blobs = run.blobs, .cap = BB_CAMERA_BLOBS_MAX };
	int rc = child < 0 ? 1 : room_side(&run, replugs, frames);
	const char end = MSG_END;
	int status = 0;
	if (child > 0 && write(run.orders, &end, 1) == 1 && waitpid(child, &status, 0) == child && status)
		rc = 1;
	bb_clock_destroy(run.clk);
	return rc;
}
