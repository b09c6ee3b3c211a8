/*
 * tests/guest/usbip_attach.c [REPLUGS]: a simulated i2c-tiny-usb adapter behind vhci; the kernel's own driver makes an
 * I2C bus of it, over which an EDID is read and an empty address asked. Unplugged and plugged in again REPLUGS times.
 * Or: usbip_attach hold SECONDS: attaches it to port 8 for other programs to look at.
 * Prints one JSON line. Exit 0 fine, 1 not, 77 no vhci.
 */
#include "tests/fixture_room.h"

#include <linux/i2c-dev.h>
#include <linux/i2c.h>
#include <signal.h>
#include <sys/ioctl.h>
#include <sys/prctl.h>
#include <sys/wait.h>

#include "sim/peer_i2c_tiny_usb.h"
#include "tests/guest/measure.h"
#include "tests/guest/usb_vhci.h"

#define EEPROM 0x50

struct simulator {
	struct rig rig;
	struct usbip_server *server;
	struct peer_i2c_tiny_usb *i2c;
	size_t item;
	unsigned port;
	uint8_t at;
};

/* Invented vendor BBT, 1920x1080 at 119.982 Hz; edid-decode says PASS. */
static const uint8_t edid[128] = {
	0x00, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0x00, 0x08, 0x54, 0x01, 0x00, 0xa0, 0x01, 0x00, 0x00,
	0x01, 0x22, 0x01, 0x04, 0xa5, 0x35, 0x1e, 0x78, 0x06, 0xee, 0x91, 0xa3, 0x54, 0x4c, 0x99, 0x26,
	0x0f, 0x50, 0x54, 0x00, 0x00, 0x00, 0x01, 0x01, 0x01, 0x01, 0x01, 0x01, 0x01, 0x01, 0x01, 0x01,
	0x01, 0x01, 0x01, 0x01, 0x01, 0x01, 0x86, 0x6f, 0x80, 0xa0, 0x70, 0x38, 0x40, 0x40, 0x30, 0x20,
	0x35, 0x00, 0x13, 0x2b, 0x21, 0x00, 0x00, 0x5a, 0x00, 0x00, 0x00, 0xfc, 0x00, 0x42, 0x42, 0x55,
	0x52, 0x53, 0x54, 0x2d, 0x53, 0x49, 0x4d, 0x0a, 0x20, 0x20, 0x00, 0x00, 0x00, 0xff, 0x00, 0x53,
	0x49, 0x4d, 0x30, 0x30, 0x30, 0x34, 0x31, 0x36, 0x0a, 0x20, 0x20, 0x00, 0x00, 0x00, 0xfd, 0x00,
	0x30, 0x78, 0x1e, 0x8c, 0x3c, 0x01, 0x0a, 0x20, 0x20, 0x20, 0x20, 0x20, 0x20, 0x20, 0x00, 0x9a,
};

static bool eeprom_write(void *ctx, uint8_t address, const uint8_t *bytes, size_t n)
{
	struct simulator *s = ctx;

	if (address == EEPROM && n)
		s->at = bytes[0];
	return address == EEPROM;
}

static bool eeprom_read(void *ctx, uint8_t address, uint8_t *bytes, size_t n)
{
	struct simulator *s = ctx;

	for (size_t i = 0; address == EEPROM && i < n; i++)
		bytes[i] = edid[s->at++ % sizeof(edid)];
	return address == EEPROM;
}

static bool obey(struct simulator *s, char what)
{
	struct sim_usb_device *dev = peer_i2c_tiny_usb_device(s->i2c);

	if (what == 'u') {
		usbip_server_withdraw(s->server, s->item);
		return true;
	}
	if (what == 'h')
		return vhci_attach(s->server, s->item, dev, 8);
	s->port = (s->port + 1) % 8;
	usbip_server_plug(s->server, s->item, dev);
	return vhci_attach(s->server, s->item, dev, s->port);
}

static int simulate(struct simulator *s, int orders)
{
	const long open_files = descriptors();
	char what = 0;

	fixture_room_init(&s->rig.fix);
	rig_world(&s->rig, 1, 1);
	if (peer_i2c_tiny_usb_create("MON1", &s->i2c) != BB_OK ||
	    !peer_i2c_tiny_usb_add(s->i2c, &(struct sim_i2c_target){ eeprom_write, eeprom_read, s }) ||
	    usbip_server_create(s->rig.clk, &s->server) != BB_OK ||
	    usbip_server_export(s->server, peer_i2c_tiny_usb_device(s->i2c), &s->item) != BB_OK)
		return 1;
	while (what != 'e') {
		rig_run(&s->rig, 100 * US);
		usbip_server_step(s->server, 0);
		if (read(orders, &what, 1) == 1 && what != 'e' && (!obey(s, what) || write(orders, &what, 1) != 1))
			return 1;
	}
	usbip_server_destroy(s->server);
	peer_i2c_tiny_usb_destroy(s->i2c);
	rig_done(&s->rig);
	return descriptors() == open_files ? 0 : 1;
}

static bool order(int orders, char what)
{
	char answer = 0;

	return write(orders, &what, 1) == 1 && read(orders, &answer, 1) == 1 && answer == what;
}

/* Opens the adapter's bus when it has come; -1: it has not in three seconds. */
static int open_bus(struct bb_clock *clk)
{
	const int64_t end_ns = bb_clock_now_ns(clk) + 3 * BB_NS_PER_S;
	char path[64], name[64];

	while (bb_clock_now_ns(clk) < end_ns) {
		for (int i = 0; i < 32; i++) {
			snprintf(path, sizeof(path), "/sys/bus/i2c/devices/i2c-%d/name", i);
			FILE *f = fopen(path, "re");
			const bool ours = f && fgets(name, sizeof(name), f) && strstr(name, "i2c-tiny-usb");
			if (f)
				fclose(f);
			snprintf(path, sizeof(path), "/dev/i2c-%d", i);
			const int fd = ours ? open(path, O_RDWR | O_CLOEXEC) : -1;
			if (fd >= 0)
				return fd;
		}
		bb_clock_run_until(clk, bb_clock_now_ns(clk) + 5 * MS);
	}
	return -1;
}

static int read_from(int fd, uint16_t address, uint8_t *bytes, uint16_t n)
{
	uint8_t zero = 0;
	struct i2c_msg m[2] = { { .addr = address, .len = 1, .buf = &zero },
		                { .addr = address, .flags = I2C_M_RD, .len = n, .buf = bytes } };
	struct i2c_rdwr_ioctl_data data = { m, 2 };

	return ioctl(fd, I2C_RDWR, &data) == 2 ? 0 : errno;
}

static int check(struct bb_clock *clk, int orders, unsigned long replugs)
{
	uint8_t bytes[128];
	unsigned long good = 0, naks = 0, gone = 0;
	int64_t read_most_ns = 0;

	for (unsigned long i = 0; i <= replugs; i++) {
		int fd = -1;
		if (!order(orders, 'p') || (fd = open_bus(clk)) < 0)
			break;
		const int64_t begun_ns = bb_clock_now_ns(clk);
		good += read_from(fd, EEPROM, bytes, sizeof(bytes)) == 0 && !memcmp(bytes, edid, sizeof(edid));
		const int64_t took_ns = bb_clock_now_ns(clk) - begun_ns;
		read_most_ns = took_ns > read_most_ns ? took_ns : read_most_ns;
		naks += read_from(fd, 0x37, bytes, 4) == ENXIO;
		if (!order(orders, 'u'))
			break;
		bb_clock_run_until(clk, bb_clock_now_ns(clk) + 300 * MS);
		gone += read_from(fd, EEPROM, bytes, sizeof(bytes)) != 0;
		close(fd);
		bb_clock_run_until(clk, bb_clock_now_ns(clk) + 100 * MS);
	}
	printf("{\"test\":\"usbip_attach\",\"plugs\":%lu,\"edid_ok\":%lu,\"nak_ok\":%lu,\"gone_ok\":%lu,"
	       "\"edid_read_max_us\":%.1f}\n",
	       replugs + 1, good, naks, gone, (double)read_most_ns * 1e-3);
	return good == replugs + 1 && naks == good && gone == good ? 0 : 1;
}

static int hold(struct bb_clock *clk, int orders, unsigned long seconds)
{
	if (!order(orders, 'h'))
		return 1;
	bb_clock_run_until(clk, bb_clock_now_ns(clk) + (int64_t)seconds * BB_NS_PER_S);
	return 0;
}

int main(int argc, char **argv)
{
	static struct simulator simulator;
	struct bb_clock *clk;
	int orders[2], status = 0;

	if (!vhci_there()) {
		printf("SKIP: no %sattach: modprobe vhci-hcd as root\n", VHCI);
		return 77;
	}
	if (socketpair(AF_UNIX, SOCK_STREAM, 0, orders) || bb_clock_posix_create(&clk) != BB_OK)
		return 1;
	const pid_t child = fork();
	if (child == 0) {
		prctl(PR_SET_PDEATHSIG, SIGKILL);
		close(orders[0]);
		fcntl(orders[1], F_SETFL, O_NONBLOCK);
		simulator.rig.clk = clk;
		_exit(simulate(&simulator, orders[1]));
	}
	close(orders[1]);
	int rc = 1;
	if (child > 0 && argc > 2 && !strcmp(argv[1], "hold"))
		rc = hold(clk, orders[0], strtoul(argv[2], NULL, 10));
	else if (child > 0)
		rc = check(clk, orders[0], argc > 1 ? strtoul(argv[1], NULL, 10) : 3);
	if (child > 0 && write(orders[0], "e", 1) == 1 && waitpid(child, &status, 0) == child && status)
		rc = 1;
	bb_clock_destroy(clk);
	return rc;
}
