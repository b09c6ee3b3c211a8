/*
 * tests/guest/can_bus.c: can_bus NEAR FAR RESTART: drivers/bus_can.c on two CAN interfaces, which may be the same
 * virtual one: what is sent comes, with its stamp, to others only; what cannot be sent is refused; error frames are
 * told; an interface that is down or was taken away comes back without a new socket. RESTART is what restarting a
 * controller that is not off the bus gives: "unsupported" or "busy". Prints the way from stamp to reader.
 */
#include "tests/guest/measure.h"

#include <linux/can.h>
#include <net/if.h>
#include <sys/socket.h>
#include <unistd.h>

#include "drivers/bus_can.h"

#define ROUNDS 1000
#define MS INT64_C(1000000)

static struct bb_clock *clk;

static struct bb_can_bus *open_bus(const char *interface)
{
	struct bb_can_bus *bus;
	struct bb_error err = { 0 };

	if (bb_can_bus_open(interface, clk, &bus, &err) != BB_OK)
		printf("%s\n", err.text);
	NEED(bus);
	return bus;
}

static void wait_for(int64_t ns)
{
	bb_clock_run_until(clk, bb_clock_now_ns(clk) + ns);
}

/* A real controller takes its time; a virtual one has delivered when the send returns. */
static enum bb_status receive(struct bb_can_bus *bus, struct bb_can_frame *f)
{
	enum bb_status status = BB_TIMEOUT;

	for (int i = 0; i < 100 && (status = bus->ops->receive(bus, f)) == BB_TIMEOUT; i++)
		wait_for(MS / 50);
	return status;
}

static bool same(const struct bb_can_frame *a, const struct bb_can_frame *b)
{
	return a->id == b->id && a->extended == b->extended && a->remote == b->remote && a->error == b->error &&
	       a->n_bytes == b->n_bytes && !memcmp(a->bytes, b->bytes, a->remote ? 0 : a->n_bytes);
}

static void frames_come_with_their_stamps(struct bb_can_bus *near, struct bb_can_bus *far, bool virtual)
{
	static int64_t age_ns[ROUNDS];
	struct bb_can_frame got;

	for (int i = 0; i < ROUNDS; i++) {
		struct bb_can_frame f = { .n_bytes = (uint8_t)(i % 9), .extended = i % 5 == 4 };
		f.remote = virtual && i % 7 == 6; /* QEMU's controllers lose what follows a remote frame */
		f.id = f.extended ? 0x1fffffffu - (uint32_t)i : (uint32_t)(i * 2 % 0x800);
		for (int k = 0; k < f.n_bytes && !f.remote; k++)
			f.bytes[k] = (uint8_t)(i * 31 + k);
		const int64_t sent_ns = bb_clock_now_ns(clk);
		NEED(near->ops->send(near, &f) == BB_OK);
		NEED(receive(far, &got) == BB_OK);
		const int64_t read_ns = bb_clock_now_ns(clk);
		NEED(same(&f, &got));
		NEED(got.at_ns >= sent_ns - 2000 && got.at_ns <= read_ns); /* the wall clock is read between two of the other */
		age_ns[i] = read_ns - got.at_ns;
		NEED(near->ops->receive(near, &got) == BB_TIMEOUT); /* not to oneself */
	}
	printf("{\"program\": \"can_bus\", \"frames\": %d", ROUNDS);
	print_latency("stamp_to_reader", age_ns, ROUNDS);
	printf("}\n");
}

static void nonsense_is_not_sent(struct bb_can_bus *near, struct bb_can_bus *far)
{
	const struct bb_can_frame bad[] = { { .n_bytes = 9 }, { .error = true, .id = 4, .n_bytes = 8 }, { .id = 0x800 },
		                            { .extended = true, .id = 0x20000000 } };
	struct bb_can_frame got;

	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++)
		NEED(near->ops->send(near, &bad[i]) == BB_ERR_USAGE);
	wait_for(MS);
	NEED(far->ops->receive(far, &got) == BB_TIMEOUT);
}

/* As the controller's driver tells them; on a virtual bus anybody can. */
static void error_frames_are_told(const char *interface, struct bb_can_bus *near)
{
	const struct sockaddr_can address = { .can_family = AF_CAN, .can_ifindex = (int)if_nametoindex(interface) };
	const struct can_frame off = { .can_id = CAN_ERR_FLAG | 0x240, .len = 8, .data = { 0, 0, 0, 0, 0, 0, 250, 3 } };
	const int fd = socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC, CAN_RAW);
	struct bb_can_frame got;

	NEED(fd >= 0 && bind(fd, (const struct sockaddr *)&address, sizeof(address)) == 0);
	NEED(write(fd, &off, sizeof(off)) == (ssize_t)sizeof(off));
	close(fd);
	NEED(receive(near, &got) == BB_OK);
	NEED(got.error && got.id == 0x240 && got.n_bytes == 8 && got.bytes[6] == 250 && got.bytes[7] == 3);
}

static void run(const char *command, const char *interface)
{
	char text[160];

	snprintf(text, sizeof(text), command, interface, interface);
	NEED(system(text) == 0);
}

static void lost_and_back(const char *interface, struct bb_can_bus *near, struct bb_can_bus *far, const char *away,
                          const char *back)
{
	const struct bb_can_frame f = { .id = 0x123, .n_bytes = 1, .bytes = { 7 } };
	struct bb_can_frame got;

	run(away, interface);
	for (int i = 0; i < 3; i++) {
		NEED(near->ops->receive(near, &got) == BB_ERR_LOST);
		NEED(near->ops->send(near, &f) == BB_ERR_LOST);
	}
	run(back, interface);
	enum bb_status status = BB_ERR_LOST;
	for (int i = 0; i < 100 && status == BB_ERR_LOST; i++) {
		wait_for(5 * MS);
		status = near->ops->receive(near, &got);
		if (far->ops->receive(far, &got) == BB_ERR_LOST)
			status = BB_ERR_LOST;
	}
	NEED(status == BB_TIMEOUT);
	NEED(near->ops->send(near, &f) == BB_OK);
	NEED(receive(far, &got) == BB_OK && same(&f, &got));
}

int main(int argc, char **argv)
{
	NEED(argc == 4 && bb_clock_posix_create(&clk) == BB_OK);
	const bool virtual = !strcmp(argv[1], argv[2]);
	struct bb_can_bus *near = open_bus(argv[1]), *far = open_bus(argv[2]);

	NEED(near->ops->restart(near) == (strcmp(argv[3], "busy") ? BB_ERR_UNSUPPORTED : BB_ERR_BUSY));
	frames_come_with_their_stamps(near, far, virtual);
	nonsense_is_not_sent(near, far);
	if (virtual)
		error_frames_are_told(argv[1], near);
	lost_and_back(argv[1], near, far, "ip link set %s down", "ip link set %s up");
	if (virtual) /* an adapter pulled and put back: its name, another index */
		lost_and_back(argv[1], near, far, "ip link del %s", "ip link add dev %s type vcan && ip link set up %s");
	near->ops->close(near);
	far->ops->close(far);
	bb_clock_destroy(clk);
	return 0;
}
