/*
 * tests/guest/smoke_can.c: `smoke_can N NEAR FAR`: N frames there and back between two raw sockets on CAN interfaces,
 * which may be the same. Checks every byte and that the kernel stamps every frame between its sending and its reading; prints the
 * round trip and the way from the kernel's stamp to the reader.
 */
#include "tests/guest/measure.h"

#include <linux/can.h>
#include <linux/can/raw.h>
#include <linux/errqueue.h>
#include <linux/net_tstamp.h>
#include <net/if.h>
#include <pthread.h>
#include <sys/socket.h>
#include <unistd.h>

enum { MAX_ROUNDS = 100000, PING_ID = 0x101, PONG_ID = 0x102 };

static int rounds;

static int open_can(const char *interface, canid_t only)
{
	const struct can_filter filter = { .can_id = only, .can_mask = CAN_SFF_MASK | CAN_EFF_FLAG };
	const int stamps = SOF_TIMESTAMPING_RX_SOFTWARE | SOF_TIMESTAMPING_SOFTWARE;
	struct sockaddr_can address = { .can_family = AF_CAN, .can_ifindex = (int)if_nametoindex(interface) };
	int fd = socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC, CAN_RAW);

	NEED(fd >= 0 && address.can_ifindex > 0);
	NEED(setsockopt(fd, SOL_CAN_RAW, CAN_RAW_FILTER, &filter, sizeof filter) == 0);
	NEED(setsockopt(fd, SOL_SOCKET, SO_TIMESTAMPING, &stamps, sizeof stamps) == 0);
	NEED(bind(fd, (struct sockaddr *)&address, sizeof address) == 0);
	return fd;
}

/* The kernel's software stamp is the first of the three; it is CLOCK_REALTIME. */
static int64_t receive(int fd, struct can_frame *frame)
{
	union {
		char bytes[CMSG_SPACE(sizeof(struct scm_timestamping))];
		struct cmsghdr align;
	} control;
	struct iovec io = { .iov_base = frame, .iov_len = sizeof *frame };
	struct msghdr message = { .msg_iov = &io, .msg_iovlen = 1, .msg_control = &control, .msg_controllen = sizeof control };
	struct scm_timestamping stamps;
	struct cmsghdr *c;

	NEED(recvmsg(fd, &message, 0) == (ssize_t)sizeof *frame);
	c = CMSG_FIRSTHDR(&message);
	NEED(c && c->cmsg_level == SOL_SOCKET && c->cmsg_type == SO_TIMESTAMPING);
	memcpy(&stamps, CMSG_DATA(c), sizeof stamps);
	return stamps.ts[0].tv_sec * 1000000000LL + stamps.ts[0].tv_nsec;
}

static void *echo(void *fd_of_socket)
{
	const int fd = *(int *)fd_of_socket;

	for (int i = 0; i < rounds; i++) {
		struct can_frame frame;

		receive(fd, &frame);
		frame.can_id = PONG_ID;
		NEED(write(fd, &frame, sizeof frame) == (ssize_t)sizeof frame);
	}
	return NULL;
}

static void one_round(int fd, int i, int64_t *round_ns, int64_t *stamp_ns)
{
	struct can_frame frame = { .can_id = PING_ID, .len = 8 }, answer;
	const int64_t sent_ns = clock_ns(CLOCK_REALTIME);
	int64_t read_ns, stamped_ns;

	memcpy(frame.data, &i, sizeof i);
	memset(frame.data + 4, 0xa5, 4);
	NEED(write(fd, &frame, sizeof frame) == (ssize_t)sizeof frame);
	stamped_ns = receive(fd, &answer);
	read_ns = clock_ns(CLOCK_REALTIME);
	NEED(answer.can_id == PONG_ID && answer.len == 8 && !memcmp(answer.data, frame.data, 8));
	NEED(stamped_ns >= sent_ns && stamped_ns <= read_ns);
	*round_ns = read_ns - sent_ns;
	*stamp_ns = read_ns - stamped_ns;
}

int main(int argc, char **argv)
{
	static int64_t round_ns[MAX_ROUNDS], stamp_ns[MAX_ROUNDS];
	pthread_t thread;
	int near, far;

	NEED(argc == 4);
	rounds = (int)strtol(argv[1], NULL, 10);
	NEED(rounds > 0 && rounds <= MAX_ROUNDS);
	near = open_can(argv[2], PONG_ID);
	far = open_can(argv[3], PING_ID);
	NEED(pthread_create(&thread, NULL, echo, &far) == 0);
	for (int i = 0; i < rounds; i++)
		one_round(near, i, &round_ns[i], &stamp_ns[i]);
	NEED(pthread_join(thread, NULL) == 0);
	printf("{\"rounds\": %d", rounds);
	print_latency("round_trip", round_ns, (size_t)rounds);
	print_latency("stamp_to_reader", stamp_ns, (size_t)rounds);
	puts("}");
	return 0;
}
