/* drivers/bus_i2c.c: see drivers/bus_i2c.h; the kernel's Documentation/i2c/dev-interface. */
#include "drivers/bus_i2c.h"

#include "drivers/ddcci_wire.h"
#include "drivers/edid.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <linux/i2c-dev.h>
#include <linux/i2c.h>

#define MOST_MESSAGES 4
#define MOST_BUSES 256
#define PART 32 /* of an EDID in one transfer */

/* Which of all the nodes that ever had this name. */
struct node {
	dev_t device;
	ino_t inode;
	struct timespec made;
};

struct bus_i2c {
	struct bb_i2c_bus base;
	bool plain, known; /* known: node is the one that was used last */
	struct node node;
	char path[96], serial[16];

	struct { /* of the bus with that serial */
		size_t n, i, at; /* buses there are; the one looked at; bytes of its EDID */
		uint16_t bus[MOST_BUSES];
		uint8_t edid[EDID_BLOCK_BYTES];
	} search;
};

static enum bb_status of_errno(int error)
{
	switch (error) {
	case ENXIO:
	case EREMOTEIO: /* adapters differ in how they say "no acknowledge" */
	case ENODEV:
	case ENOENT:
		return BB_ERR_LOST;
	case EAGAIN:
	case EBUSY:
		return BB_ERR_BUSY; /* arbitration lost, or another owner */
	case EACCES:
	case EPERM:
		return BB_ERR_REFUSED;
	case ENOTTY:
	case EINVAL:
	case EOPNOTSUPP:
		return BB_ERR_UNSUPPORTED;
	case ENOMEM:
		return BB_ERR_NOMEM;
	default:
		return BB_ERR_IO;
	}
}

static enum bb_status transfer_plain(int fd, const struct bb_i2c_message *m)
{
	if (ioctl(fd, I2C_SLAVE, (unsigned long)m->address) < 0)
		return of_errno(errno);
	const ssize_t n = m->read ? read(fd, m->bytes, m->n_bytes) : write(fd, m->bytes, m->n_bytes);
	if (n < 0)
		return of_errno(errno);
	return n == m->n_bytes ? BB_OK : BB_ERR_IO;
}

static enum bb_status transfer_rdwr(int fd, struct bb_i2c_message *messages, size_t n)
{
	struct i2c_msg raw[MOST_MESSAGES];
	struct i2c_rdwr_ioctl_data all = { .msgs = raw, .nmsgs = (unsigned int)n };

	for (size_t i = 0; i < n; i++)
		raw[i] = (struct i2c_msg){ .addr = messages[i].address,
					   .flags = messages[i].read ? I2C_M_RD : 0,
					   .len = messages[i].n_bytes,
					   .buf = messages[i].bytes };
	const int done = ioctl(fd, I2C_RDWR, &all);
	if (done < 0)
		return of_errno(errno);
	return done == (int)n ? BB_OK : BB_ERR_IO;
}

static enum bb_status transfer_on(const struct bus_i2c *b, int fd, struct bb_i2c_message *messages, size_t n)
{
	enum bb_status status = BB_OK;

	if (!b->plain)
		return transfer_rdwr(fd, messages, n);
	for (size_t i = 0; i < n && status == BB_OK; i++)
		status = transfer_plain(fd, &messages[i]);
	return status;
}

/* ---- the node ---- */

/* An I2C adapter's node, open; -1 with errno. */
static int open_node(const char *path)
{
	unsigned long functions = 0;
	const int fd = open(path, O_RDWR | O_CLOEXEC);

	if (fd < 0 || (ioctl(fd, I2C_FUNCS, &functions) == 0 && (functions & I2C_FUNC_I2C)))
		return fd;
	const int error = functions ? EOPNOTSUPP : errno;
	close(fd);
	errno = error;
	return -1;
}

/* By what the file system says: a node that comes back has another inode. */
static bool same_node(const struct node *a, const struct node *b)
{
	return a->device == b->device && a->inode == b->inode && a->made.tv_sec == b->made.tv_sec &&
	       a->made.tv_nsec == b->made.tv_nsec;
}

static bool identify(int fd, struct node *out)
{
	struct stat s;

	if (fstat(fd, &s))
		return false;
	*out = (struct node){ .device = s.st_dev, .inode = s.st_ino, .made = s.st_mtim };
	return true;
}

/* ---- the bus with a serial ---- */

/* One of the host's own, with its memory modules on it: nothing to look at. */
static bool is_host_bus(unsigned int number)
{
	char path[64], name[64] = "";

	snprintf(path, sizeof(path), "/sys/bus/i2c/devices/i2c-%u/name", number);
	FILE *f = fopen(path, "re");
	const bool read = f && fgets(name, sizeof(name), f);
	if (f)
		fclose(f);
	return read && !strncmp(name, "SMBus", 5);
}

static void list_buses(struct bus_i2c *b)
{
	DIR *dir = opendir("/dev");
	struct dirent *entry;
	unsigned int number;
	char rest;

	b->search.n = b->search.i = b->search.at = 0;
	while (dir && (entry = readdir(dir)) && b->search.n < MOST_BUSES)
		if (sscanf(entry->d_name, "i2c-%5u%c", &number, &rest) == 1 && number < UINT16_MAX && !is_host_bus(number))
			b->search.bus[b->search.n++] = (uint16_t)number;
	if (dir)
		closedir(dir);
}

static bool has_serial(const struct bus_i2c *b)
{
	struct edid_info info;
	char number[16];

	if (edid_parse(b->search.edid, sizeof(b->search.edid), &info) != BB_OK)
		return false;
	snprintf(number, sizeof(number), "%lu", (unsigned long)info.serial);
	return !strcmp(info.serial_text, b->serial) || (info.serial && !strcmp(number, b->serial));
}

/* A part of the EDID of one bus; the host does not wait for more than that. BB_ERR_BUSY: go on; BB_OK: found. */
static enum bb_status look(struct bus_i2c *b)
{
	uint8_t offset = (uint8_t)b->search.at;
	struct bb_i2c_message m[] = { { EDID_ADDRESS, false, 1, &offset },
				      { EDID_ADDRESS, true, PART, b->search.edid + b->search.at } };
	struct node node;

	if (b->search.i >= b->search.n)
		list_buses(b);
	if (!b->search.n)
		return BB_ERR_LOST;
	snprintf(b->path, sizeof(b->path), "/dev/i2c-%u", (unsigned int)b->search.bus[b->search.i]);
	const int fd = open_node(b->path);
	const bool there = fd >= 0 && identify(fd, &node) && transfer_on(b, fd, m, BB_ARRAY_LEN(m)) == BB_OK;
	if (fd >= 0)
		close(fd);
	b->search.at += PART;
	if (there && b->search.at < EDID_BLOCK_BYTES)
		return BB_ERR_BUSY;
	b->search.at = 0;
	if (there && has_serial(b)) {
		b->base.n_reopened += b->node.inode != 0 && !same_node(&node, &b->node);
		b->node = node;
		b->known = true;
		b->search.n = b->search.i = 0;
		return BB_OK;
	}
	return ++b->search.i < b->search.n ? BB_ERR_BUSY : BB_ERR_LOST;
}

/* ---- the seam ---- */

/* The node that was used last, or the next of its name: with a serial that one has to prove itself. */
static enum bb_status open_bus(struct bus_i2c *b, int *fd)
{
	struct node node;

	*fd = open_node(b->path);
	if (*fd < 0)
		return errno == ENOMEM ? BB_ERR_NOMEM : errno == EACCES ? BB_ERR_REFUSED : BB_ERR_LOST;
	const bool same = identify(*fd, &node) && b->known && same_node(&node, &b->node);
	if (same)
		return BB_OK;
	if (b->serial[0])
		return BB_ERR_LOST;
	b->base.n_reopened += b->node.inode != 0;
	b->node = node;
	b->known = true;
	return BB_OK;
}

static enum bb_status transfer(struct bb_i2c_bus *bus, struct bb_i2c_message *messages, size_t n)
{
	struct bus_i2c *b = bb_container_of(bus, struct bus_i2c, base);
	enum bb_status status = BB_OK;
	int fd;

	if (!n || n > MOST_MESSAGES)
		return BB_ERR_USAGE;
	if (b->serial[0] && !b->known)
		status = look(b);
	if (status != BB_OK)
		return status;
	status = open_bus(b, &fd);
	const bool there = status == BB_OK;
	if (there)
		status = transfer_on(b, fd, messages, n);
	/* Even asleep a display shows its EDID: where none is, it has been moved. */
	if (status == BB_ERR_LOST && (!there || messages[0].address == EDID_ADDRESS))
		b->known = false;
	if (fd >= 0)
		close(fd);
	return status;
}

static void close_bus(struct bb_i2c_bus *bus)
{
	free(bb_container_of(bus, struct bus_i2c, base));
}

static const struct bb_i2c_ops ops = { transfer, close_bus };

enum bb_status bus_i2c_open(const struct bus_i2c_options *options, struct bb_clock *clk, struct bb_i2c_bus **out)
{
	struct bus_i2c *b = calloc(1, sizeof(*b));

	*out = NULL;
	if (!b)
		return BB_ERR_NOMEM;
	b->base = (struct bb_i2c_bus){ .ops = &ops, .clk = clk };
	b->plain = options->plain;
	snprintf(b->path, sizeof(b->path), "%s", options->path);
	snprintf(b->serial, sizeof(b->serial), "%s", options->serial);
	const int fd = b->serial[0] ? -1 : open_node(b->path);
	if (fd < 0 && !b->serial[0]) {
		const int error = errno;
		free(b);
		errno = error;
		return of_errno(error);
	}
	if (fd >= 0) {
		b->known = identify(fd, &b->node);
		close(fd);
	}
	*out = &b->base;
	return BB_OK;
}
