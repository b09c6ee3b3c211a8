/*
 * tests/test_usbip.c: simulated USB devices over USB/IP, byte for byte, with a client written here from the protocol:
 * over loopback and over a socket pair, golden bytes in both directions, and clients that talk nonsense or nothing.
 */
#include "tests/fixture_room.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include "sim/peer_camera.h"
#include "sim/peer_i2c_tiny_usb.h"
#include "sim/usbip_server.h"

struct bench {
	struct rig rig;
	struct usbip_server *server;
	struct peer_i2c_tiny_usb *i2c;
	struct peer_camera *camera;
	struct bb_camera *model;
	size_t i2c_item, camera_item;
	uint16_t port;
	uint8_t eeprom[128], at; /* the target: an EEPROM at 0x50 */
	uint8_t got[70000];
	size_t n_got;
};

static bool eeprom_write(void *ctx, uint8_t address, const uint8_t *bytes, size_t n)
{
	struct bench *b = ctx;

	if (address != 0x50)
		return false;
	if (n)
		b->at = bytes[0];
	for (size_t i = 1; i < n; i++)
		b->eeprom[b->at++ % 128] = bytes[i];
	return true;
}

static bool eeprom_read(void *ctx, uint8_t address, uint8_t *bytes, size_t n)
{
	struct bench *b = ctx;

	if (address != 0x50)
		return false;
	for (size_t i = 0; i < n; i++)
		bytes[i] = b->eeprom[b->at++ % 128];
	return true;
}

static int setup(void **state)
{
	struct bench *b = calloc(1, sizeof(*b));
	const struct peer_camera_options options = { .serial = "CAM1", .stamped = true };

	if (!b)
		return -1;
	*state = b;
	rig_init(&b->rig, 1, 1);
	b->model = rig_camera(&b->rig, 0);
	assert_int_equal(peer_camera_create(b->model, &options, &b->camera), BB_OK);
	assert_int_equal(peer_i2c_tiny_usb_create("MON1", &b->i2c), BB_OK);
	for (size_t i = 0; i < sizeof(b->eeprom); i++)
		b->eeprom[i] = (uint8_t)(i * 3);
	assert_true(peer_i2c_tiny_usb_add(b->i2c, &(struct sim_i2c_target){ eeprom_write, eeprom_read, b }));
	assert_int_equal(usbip_server_create(b->rig.clk, &b->server), BB_OK);
	assert_int_equal(usbip_server_export(b->server, peer_i2c_tiny_usb_device(b->i2c), &b->i2c_item), BB_OK);
	assert_int_equal(usbip_server_export(b->server, peer_camera_usb(b->camera), &b->camera_item), BB_OK);
	b->port = 0;
	assert_int_equal(usbip_server_listen(b->server, &b->port), BB_OK);
	return 0;
}

static int teardown(void **state)
{
	struct bench *b = *state;

	usbip_server_destroy(b->server);
	peer_camera_destroy(b->camera);
	peer_i2c_tiny_usb_destroy(b->i2c);
	bb_camera_close(b->model);
	rig_done(&b->rig);
	free(b);
	return 0;
}

/* The client */

static int dial(struct bench *b)
{
	struct sockaddr_in at = { .sin_family = AF_INET, .sin_port = htons(b->port) };
	const int fd = socket(AF_INET, SOCK_STREAM, 0);

	at.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
	assert_true(fd >= 0);
	assert_int_equal(connect(fd, (struct sockaddr *)&at, sizeof(at)), 0);
	assert_int_equal(setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &(int){ 1 }, sizeof(int)), 0); /* as usbip does */
	assert_int_equal(fcntl(fd, F_SETFL, O_NONBLOCK), 0);
	return fd;
}

/* Both sides until nothing moves; true: the connection is still there. */
static bool exchange(struct bench *b, int fd, const void *bytes, size_t n)
{
	const uint8_t *at = bytes;

	b->n_got = 0;
	for (int idle = 0; idle < 4;) {
		const ssize_t sent = n ? send(fd, at, n, MSG_NOSIGNAL) : 0;
		if (sent > 0) {
			at += sent;
			n -= (size_t)sent;
		}
		usbip_server_step(b->server, sent > 0 ? 0 : 1);
		const ssize_t got = recv(fd, b->got + b->n_got, sizeof(b->got) - b->n_got, 0);
		if (got > 0)
			b->n_got += (size_t)got;
		if (got == 0 || (got < 0 && errno == ECONNRESET))
			return false;
		idle = got > 0 || sent > 0 ? 0 : idle + 1;
	}
	return true;
}

static uint32_t u32(const uint8_t *p)
{
	return (uint32_t)p[0] << 24 | (uint32_t)p[1] << 16 | (uint32_t)p[2] << 8 | p[3];
}

static size_t words(uint8_t *out, size_t n, const uint32_t *w)
{
	for (size_t i = 0; i < n; i++)
		for (size_t k = 0; k < 4; k++)
			out[4 * i + k] = (uint8_t)(w[i] >> (24 - 8 * k));
	return 4 * n;
}

struct urb {
	uint32_t seqnum, devid, in, endpoint, length;
	uint8_t setup[8];
};

static size_t put_urb(uint8_t *out, const struct urb *u)
{
	const uint32_t w[10] = { 1, u->seqnum, u->devid, u->in, u->endpoint, u->in ? 0x200 : 0, u->length, 0, 0, 0 };

	words(out, 10, w);
	memcpy(out + 40, u->setup, 8);
	return 48;
}

static const char import_i2c[40] = "\x01\x11\x80\x03\0\0\0\0" "1-1";
static const char import_camera[40] = "\x01\x11\x80\x03\0\0\0\0" "1-2";

static int import_device(struct bench *b, const char request[40])
{
	const int fd = dial(b);

	assert_true(exchange(b, fd, request, 40));
	assert_int_equal(b->n_got, 8 + 312);
	assert_memory_equal(b->got, "\x01\x11\x00\x03\0\0\0\0", 8);
	return fd;
}

/* A control transfer; returns its status, the bytes in b->got + 48. */
static int32_t control(struct bench *b, int fd, uint32_t item, const uint8_t setup_bytes[8], const uint8_t *out,
                       size_t n_out)
{
	static uint32_t seqnum = 100;
	struct urb u = { .seqnum = ++seqnum, .devid = usbip_server_devid(b->server, item),
		         .in = setup_bytes[0] >> 7, .length = setup_bytes[6] | (uint32_t)setup_bytes[7] << 8 };
	uint8_t bytes[48 + 256];

	memcpy(u.setup, setup_bytes, 8);
	size_t n = put_urb(bytes, &u);
	if (n_out)
		memcpy(bytes + n, out, n_out);
	assert_true(exchange(b, fd, bytes, n + n_out));
	assert_true(b->n_got >= 48);
	assert_int_equal(u32(b->got), 3);
	assert_int_equal(u32(b->got + 4), seqnum);
	return (int32_t)u32(b->got + 20);
}
#define SETUP(...) (const uint8_t[8]){ __VA_ARGS__ }

static void the_list(void **state)
{
	struct bench *b = *state;
	const int fd = dial(b);

	assert_false(exchange(b, fd, "\x01\x11\x80\x05\0\0\0\0", 8)); /* closes when it has said it */
	assert_int_equal(b->n_got, 12 + 2 * 316);
	assert_memory_equal(b->got, "\x01\x11\x00\x05\0\0\0\0\0\0\0\x02", 12);
	const uint8_t *i2c = b->got + 12, *camera = b->got + 12 + 316;
	assert_string_equal((const char *)i2c + 256, "1-1");
	assert_int_equal(u32(i2c + 288), 1);
	assert_int_equal(u32(i2c + 292), 2);
	assert_int_equal(u32(i2c + 296), 1); /* low speed */
	assert_memory_equal(i2c + 300, "\x1C\x40\x05\x34\x02\x05\xFF\0\0\0\x01\x01", 12);
	assert_memory_equal(camera + 300, "\x13\x1D\x01\x57\x01\x00\xFF\0\0\0\x01\x01\xFF\xFF\xFF\0", 16);
	close(fd);
}

static void enumeration(void **state)
{
	struct bench *b = *state;
	const int fd = import_device(b, import_i2c);
	const uint32_t i = (uint32_t)b->i2c_item;

	assert_int_equal(control(b, fd, i, SETUP(0x80, 6, 0, 1, 0, 0, 64, 0), NULL, 0), 0);
	assert_int_equal(u32(b->got + 24), 18);
	assert_int_equal(b->n_got, 48 + 18);
	assert_int_equal(control(b, fd, i, SETUP(0x80, 6, 0, 2, 0, 0, 9, 0), NULL, 0), 0);
	assert_int_equal(b->got[48 + 2], 18);
	assert_int_equal(control(b, fd, i, SETUP(0x80, 6, 0, 3, 0, 0, 255, 0), NULL, 0), 0);
	assert_memory_equal(b->got + 48, "\x04\x03\x09\x04", 4);
	assert_int_equal(control(b, fd, i, SETUP(0x80, 6, 3, 3, 9, 4, 255, 0), NULL, 0), 0);
	assert_memory_equal(b->got + 48, "\x0A\x03M\0O\0N\0" "1\0", 10);
	assert_int_equal(control(b, fd, i, SETUP(0x00, 9, 1, 0, 0, 0, 0, 0), NULL, 0), 0);
	assert_int_equal(control(b, fd, i, SETUP(0x00, 9, 7, 0, 0, 0, 0, 0), NULL, 0), -32);
	assert_int_equal(control(b, fd, i, SETUP(0x80, 6, 0, 15, 0, 0, 255, 0), NULL, 0), -32);
	assert_int_equal(control(b, fd, i, SETUP(0x80, 0, 0, 0, 0, 0, 2, 0), NULL, 0), 0);
	close(fd);
}

static void i2c_messages(void **state)
{
	struct bench *b = *state;
	const int fd = import_device(b, import_i2c);
	const uint32_t i = (uint32_t)b->i2c_item;

	assert_int_equal(control(b, fd, i, SETUP(0x41, 2, 10, 0, 0, 0, 0, 0), NULL, 0), 0); /* as the kernel's probe */
	assert_int_equal(peer_i2c_tiny_usb_delay_us(b->i2c), 10);
	assert_int_equal(control(b, fd, i, SETUP(0xC1, 1, 0, 0, 0, 0, 4, 0), NULL, 0), 0);
	assert_memory_equal(b->got + 48, "\x01\x00\xFF\x8E", 4);
	assert_int_equal(control(b, fd, i, SETUP(0xC1, 0, 0x34, 0x12, 0, 0, 2, 0), NULL, 0), 0);
	assert_memory_equal(b->got + 48, "\x34\x12", 2);
	/* Write the offset, read 8 bytes; flags as the kernel sends them, with 0x0200 beside the direction. */
	assert_int_equal(control(b, fd, i, SETUP(0x41, 5, 0x00, 0x02, 0x50, 0, 1, 0), (const uint8_t[]){ 16 }, 1), 0);
	assert_int_equal(u32(b->got + 24), 1);
	assert_int_equal(control(b, fd, i, SETUP(0xC1, 3, 0, 0, 0, 0, 1, 0), NULL, 0), 0);
	assert_int_equal(b->got[48], 1);
	assert_int_equal(control(b, fd, i, SETUP(0xC1, 6, 0x01, 0x02, 0x50, 0, 8, 0), NULL, 0), 0);
	assert_memory_equal(b->got + 48, b->eeprom + 16, 8);
	/* Nobody at 0x37: the full length and status 2. */
	assert_int_equal(control(b, fd, i, SETUP(0xC1, 7, 0x01, 0x02, 0x37, 0, 8, 0), NULL, 0), 0);
	assert_int_equal(u32(b->got + 24), 8);
	assert_int_equal(control(b, fd, i, SETUP(0xC1, 3, 0, 0, 0, 0, 1, 0), NULL, 0), 0);
	assert_int_equal(b->got[48], 2);
	peer_i2c_tiny_usb_world_stall(b->i2c, 1);
	assert_int_equal(control(b, fd, i, SETUP(0xC1, 7, 0x01, 0x02, 0x50, 0, 8, 0), NULL, 0), -32);
	assert_int_equal(control(b, fd, i, SETUP(0xC1, 9, 0, 0, 0, 0, 1, 0), NULL, 0), -32);
	close(fd);
}

/* The protocol's own example: an interrupt-IN submit of 64 bytes, with the padding word the document shows. */
static void a_parked_transfer_and_its_unlink(void **state)
{
	struct bench *b = *state;
	const uint32_t devid = usbip_server_devid(b->server, b->camera_item);
	const uint32_t submit[12] = { 1, 0xd05, devid, 1, 2, 0x200, 64, 0xffffffff, 0, 4, 0, 0 };
	const uint32_t unlink_it[12] = { 2, 0xd06, devid, 0, 0, 0xd05 };
	const int fd = import_device(b, import_camera);
	uint8_t bytes[96];

	words(bytes, 12, submit);
	assert_false(exchange(b, fd, bytes, 48) && b->n_got); /* nothing to say yet: parked */
	words(bytes, 12, unlink_it);
	assert_true(exchange(b, fd, bytes, 48));
	assert_int_equal(b->n_got, 48);
	assert_int_equal(u32(b->got), 4);
	assert_int_equal(u32(b->got + 4), 0xd06);
	assert_int_equal((int32_t)u32(b->got + 20), -104);
	assert_true(exchange(b, fd, bytes, 48)); /* again: it is no more */
	assert_int_equal(u32(b->got + 20), 0);
	close(fd);
}

static void say(struct bench *b, int fd, uint32_t seqnum, const uint8_t *command, size_t n)
{
	const struct urb u = { .seqnum = seqnum, .devid = usbip_server_devid(b->server, b->camera_item), .endpoint = 1,
		               .length = (uint32_t)n };
	uint8_t bytes[64];

	put_urb(bytes, &u);
	memcpy(bytes + 48, command, n);
	assert_true(exchange(b, fd, bytes, 48 + n));
	assert_int_equal(b->n_got, 48);
	assert_int_equal(u32(b->got + 20), 0);
	assert_int_equal(u32(b->got + 24), n);
}

static void frames_wake_parked_transfers_in_order(void **state)
{
	struct bench *b = *state;
	const uint32_t devid = usbip_server_devid(b->server, b->camera_item);
	const int fd = import_device(b, import_camera);
	uint8_t bytes[48];
	uint32_t answered = 0;

	say(b, fd, 1, (const uint8_t[]){ 0x23, 0x42, 0x10, 50, 0, 0 }, 6);
	say(b, fd, 2, (const uint8_t[]){ 0x14, 0 }, 2);
	for (uint32_t i = 0; i < 3; i++) {
		put_urb(bytes, &(struct urb){ .seqnum = 10 + i, .devid = devid, .in = 1, .endpoint = 2,
		                              .length = 16384 });
		assert_true(exchange(b, fd, bytes, 48));
		assert_int_equal(b->n_got, 0);
	}
	for (int i = 0; i < 100 && answered < 3; i++) {
		rig_run(&b->rig, MS);
		assert_true(exchange(b, fd, NULL, 0));
		if (!b->n_got)
			continue;
		assert_int_equal(u32(b->got + 4), 10 + answered);
		assert_int_equal(u32(b->got + 20), 0);
		assert_int_equal(b->n_got, 48 + u32(b->got + 24));
		assert_int_equal(b->got[48 + 1], 0x10);
		answered++;
	}
	assert_int_equal(answered, 3);
	/* One waits, then a frame is ready at the very moment another comes: it goes to the one that waits. */
	put_urb(bytes, &(struct urb){ .seqnum = 20, .devid = devid, .in = 1, .endpoint = 2, .length = 16384 });
	assert_true(exchange(b, fd, bytes, 48));
	assert_int_equal(b->n_got, 0);
	rig_run(&b->rig, 20 * MS);
	put_urb(bytes, &(struct urb){ .seqnum = 21, .devid = devid, .in = 1, .endpoint = 2, .length = 16384 });
	assert_true(exchange(b, fd, bytes, 48));
	assert_true(b->n_got > 48);
	assert_int_equal(u32(b->got + 4), 20);
	close(fd);
}

/* vhci's way: one end of a socket pair, no import. */
static void a_socket_pair_and_unplug(void **state)
{
	struct bench *b = *state;
	int fd[2];

	for (int round = 0; round < 100; round++) {
		assert_int_equal(socketpair(AF_UNIX, SOCK_STREAM, 0, fd), 0);
		assert_int_equal(fcntl(fd[0], F_SETFL, O_NONBLOCK), 0);
		assert_int_equal(usbip_server_adopt(b->server, b->camera_item, fd[1]), BB_OK);
		assert_int_equal(usbip_server_adopt(b->server, b->camera_item, -1), BB_ERR_BUSY);
		assert_int_equal(control(b, fd[0], (uint32_t)b->camera_item, SETUP(0x80, 6, 0, 1, 0, 0, 18, 0), NULL, 0),
		                 0);
		assert_int_equal(usbip_server_clients(b->server), 1);
		if (round & 1) { /* the device goes, or the host */
			usbip_server_withdraw(b->server, b->camera_item);
			assert_false(exchange(b, fd[0], NULL, 0));
			usbip_server_plug(b->server, b->camera_item, peer_camera_usb(b->camera));
		}
		close(fd[0]);
		usbip_server_step(b->server, 0);
		assert_int_equal(usbip_server_clients(b->server), 0);
	}
}

static void one_device_has_one_host(void **state)
{
	struct bench *b = *state;
	const int first = import_device(b, import_camera), second = dial(b);

	assert_false(exchange(b, second, import_camera, 40));
	assert_int_equal(b->n_got, 8);
	assert_memory_equal(b->got, "\x01\x11\x00\x03\0\0\0\x04", 8);
	close(second);
	close(first);
	usbip_server_step(b->server, 0);
	close(import_device(b, import_camera));
}

static void refused(struct bench *b, const void *bytes, size_t n)
{
	const int fd = dial(b);

	assert_false(exchange(b, fd, bytes, n));
	close(fd);
	assert_int_equal(usbip_server_clients(b->server), 0);
}

static void refused_attached(struct bench *b, uint32_t at, uint32_t value)
{
	const int fd = import_device(b, import_camera);
	uint8_t bytes[48];

	put_urb(bytes, &(struct urb){ .seqnum = 1, .devid = usbip_server_devid(b->server, b->camera_item), .in = 1,
	                              .endpoint = 2, .length = 64 });
	words(bytes + at, 1, &value);
	assert_false(exchange(b, fd, bytes, 48));
	close(fd);
}

static void nonsense_ends_the_connection(void **state)
{
	struct bench *b = *state;
	uint8_t junk[4096];

	for (size_t i = 0; i < sizeof(junk); i++)
		junk[i] = (uint8_t)(i * 131 + 7);
	refused(b, junk, sizeof(junk));
	refused(b, "GET / HTTP/1.0\r\n\r\n", 18);
	refused(b, "\x01\x06\x80\x05\0\0\0\0", 8); /* another version */
	refused(b, "\x01\x11\x80\x09\0\0\0\0", 8);
	refused_attached(b, 0, 7);               /* command */
	refused_attached(b, 8, 0x00020002);      /* another device */
	refused_attached(b, 12, 2);              /* direction */
	refused_attached(b, 16, 16);             /* endpoint */
	refused_attached(b, 24, 0x7fffffff);     /* length */
	refused_attached(b, 24, 0xffffffff);
	refused_attached(b, 32, 12);             /* isochronous */
	assert_int_equal(usbip_server_clients(b->server), 0);
	close(import_device(b, import_camera)); /* and it still serves */
}

static void more_parked_than_allowed(void **state)
{
	struct bench *b = *state;
	const int fd = import_device(b, import_camera);
	uint8_t bytes[48];
	bool alive = true;
	uint32_t n = 0;

	while (alive && n < 1000) {
		put_urb(bytes, &(struct urb){ .seqnum = ++n, .devid = usbip_server_devid(b->server, b->camera_item),
		                              .in = 1, .endpoint = 2, .length = 64 });
		alive = exchange(b, fd, bytes, 48);
	}
	assert_int_equal(n, USBIP_PARKED_MAX + 1);
	close(fd);
}

static void half_a_request_and_then_nothing(void **state)
{
	struct bench *b = *state;
	const int half = dial(b), silent = dial(b), slow = dial(b);

	assert_true(exchange(b, half, import_camera, 7));
	assert_true(exchange(b, silent, NULL, 0));
	assert_int_equal(usbip_server_clients(b->server), 3);
	for (size_t i = 0; i < 39; i++) { /* a byte every 20 ms */
		rig_run(&b->rig, 20 * MS);
		assert_true(exchange(b, slow, import_camera + i, 1));
	}
	assert_int_equal(usbip_server_clients(b->server), 3);
	assert_true(exchange(b, slow, import_camera + 39, 1));
	assert_int_equal(b->n_got, 320);
	rig_run(&b->rig, BB_NS_PER_S);
	usbip_server_step(b->server, 0);
	assert_int_equal(usbip_server_clients(b->server), 1); /* the one that has a device may be silent for ever */
	rig_run(&b->rig, 3600 * BB_NS_PER_S);
	usbip_server_step(b->server, 0);
	assert_int_equal(usbip_server_clients(b->server), 1);
	close(half);
	close(silent);
	close(slow);
}

static void a_client_that_does_not_read(void **state)
{
	struct bench *b = *state;
	const int fd = import_device(b, import_i2c);
	uint8_t bytes[48];
	size_t taken = 0;

	put_urb(bytes, &(struct urb){ .seqnum = 9, .devid = usbip_server_devid(b->server, b->i2c_item), .in = 1,
	                              .length = 65535, .setup = { 0xC1, 7, 1, 0, 0x50, 0, 0xFF, 0xFF } });
	for (int idle = 0; idle < 10;) { /* 64 KiB are owed for each: it must stop taking them */
		const ssize_t n = send(fd, bytes, sizeof(bytes), MSG_NOSIGNAL);
		usbip_server_step(b->server, 0);
		taken += n == sizeof(bytes);
		idle = n > 0 ? 0 : idle + 1;
		assert_true(taken < 2000000);
	}
	assert_int_equal(usbip_server_clients(b->server), 1);
	close(fd);
	usbip_server_step(b->server, 0);
	usbip_server_step(b->server, 0);
}

#define T(f) cmocka_unit_test_setup_teardown(f, setup, teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		T(the_list), T(enumeration), T(i2c_messages), T(a_parked_transfer_and_its_unlink),
		T(frames_wake_parked_transfers_in_order), T(a_socket_pair_and_unplug), T(one_device_has_one_host),
		T(nonsense_ends_the_connection), T(more_parked_than_allowed), T(half_a_request_and_then_nothing),
		T(a_client_that_does_not_read),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
