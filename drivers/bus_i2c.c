/* drivers/bus_i2c.c: see drivers/bus_i2c.h; the kernel's Documentation/i2c/dev-interface. */
#include "drivers/bus_i2c.h"

#include "drivers/ddcci_wire.h"
#include "drivers/edid.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <linux/i2c-dev.h>
#include <linux/i2c.h>

#define MOST_MESSAGES 4
#define MOST_BYTES 64
#define MOST_BUSES 256
#define PART 32 /* of an EDID in one transfer */
#define STACK_BYTES ((size_t)256 << 10)

/* Which of all the nodes that ever had this name. */
struct node {
	dev_t device;
	ino_t inode;
	struct timespec made;
};

enum job_state { JOB_NONE, JOB_ASKED, JOB_DONE };

struct bus_i2c {
	struct bb_i2c_bus base;
	pthread_mutex_t lock; /* for what stands up to "the worker's" */
	pthread_cond_t asked;
	bool over; /* the worker frees all of it */
	struct {
		enum job_state state;
		enum bb_status status;
		uint32_t n_reopened;
		size_t n;
		struct bb_i2c_message message[MOST_MESSAGES];
		uint8_t bytes[MOST_MESSAGES][MOST_BYTES];
	} job;

	/* the worker's */
	bool plain, known; /* known: node is the one that was used last */
	uint32_t n_reopened;
	struct node node;
	char path[96], serial[16];
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

/* False with errno when it is none, or speaks SMBus only. Some adapters are asked over their wire: once is enough. */
static bool is_i2c(int fd)
{
	unsigned long functions = 0;

	if (ioctl(fd, I2C_FUNCS, &functions) < 0)
		return false;
	errno = EOPNOTSUPP;
	return (functions & I2C_FUNC_I2C) != 0;
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

/*
 * One of the host's own, with memory modules, sensors or a touch pad on it: nothing to look at, as ddcutil does not either
 * (src/util/sysfs_i2c_util.c). Nor is one that nobody can name.
 */
static bool is_host_bus(unsigned long number)
{
	static const char *const host[] = { "SMBus", "Synopsys DesignWare", "soc:i2cdsi", "smu",
					    "mac-io", "u4", "AMDGPU SMU" };
	char path[64], name[64] = "";

	snprintf(path, sizeof(path), "/sys/bus/i2c/devices/i2c-%lu/name", number);
	FILE *f = fopen(path, "re");
	const bool read = f && fgets(name, sizeof(name), f);
	if (f)
		fclose(f);
	for (size_t i = 0; i < BB_ARRAY_LEN(host) && read; i++)
		if (!strncmp(name, host[i], strlen(host[i])))
			return true;
	return !read;
}

static size_t list_buses(uint16_t bus[MOST_BUSES])
{
	DIR *dir = opendir("/dev");
	struct dirent *entry;
	size_t n = 0;

	while (dir && (entry = readdir(dir)) && n < MOST_BUSES) {
		char *end = entry->d_name;
		const unsigned long number = strncmp(end, "i2c-", 4) ? UINT16_MAX : strtoul(end + 4, &end, 10);
		if (number < UINT16_MAX && !*end && !is_host_bus(number))
			bus[n++] = (uint16_t)number;
	}
	if (dir)
		closedir(dir);
	return n;
}

static bool has_serial(const struct bus_i2c *b, int fd)
{
	uint8_t edid[EDID_BLOCK_BYTES] = { 0 };
	struct edid_info info;
	char number[16];

	for (size_t at = 0; at < sizeof(edid); at += PART) {
		uint8_t offset = (uint8_t)at;
		struct bb_i2c_message m[] = { { EDID_ADDRESS, false, 1, &offset },
					      { EDID_ADDRESS, true, PART, edid + at } };
		if (transfer_on(b, fd, m, BB_ARRAY_LEN(m)) != BB_OK)
			return false;
	}
	if (edid_parse(edid, sizeof(edid), &info) != BB_OK)
		return false;
	snprintf(number, sizeof(number), "%lu", (unsigned long)info.serial);
	return !strcmp(info.serial_text, b->serial) || (info.serial && !strcmp(number, b->serial));
}

static void note_node(struct bus_i2c *b, const struct node *node)
{
	b->n_reopened += b->node.inode != 0 && !same_node(node, &b->node);
	b->node = *node;
	b->known = true;
}

/* Open, or -1. */
static int find(struct bus_i2c *b)
{
	uint16_t bus[MOST_BUSES];
	const size_t n = list_buses(bus);
	struct node node;

	for (size_t i = 0; i < n; i++) {
		snprintf(b->path, sizeof(b->path), "/dev/i2c-%u", (unsigned int)bus[i]);
		const int fd = open(b->path, O_RDWR | O_CLOEXEC);
		if (fd >= 0 && is_i2c(fd) && identify(fd, &node) && has_serial(b, fd)) {
			note_node(b, &node);
			return fd;
		}
		if (fd >= 0)
			close(fd);
	}
	errno = ENODEV;
	return -1;
}

/* ---- the worker: whatever a driver of the kernel's does with a call, nobody waits for it ---- */

/* The node that was used last, or the next of its name: with a serial that one has to prove itself. */
static int open_bus(struct bus_i2c *b)
{
	struct node node;

	if (b->serial[0] && !b->known)
		return find(b);
	const int fd = open(b->path, O_RDWR | O_CLOEXEC);
	if (fd < 0)
		return fd;
	const bool told = identify(fd, &node), same = told && b->known && same_node(&node, &b->node);
	if (same || (told && !b->serial[0] && is_i2c(fd))) {
		note_node(b, &node);
		return fd;
	}
	close(fd);
	errno = ENODEV;
	return -1;
}

static enum bb_status carry_out(struct bus_i2c *b, struct bb_i2c_message *messages, size_t n)
{
	const int fd = open_bus(b);
	enum bb_status status = BB_ERR_LOST;

	if (fd >= 0) {
		status = transfer_on(b, fd, messages, n);
		close(fd);
	} else if (errno == ENOMEM) {
		return BB_ERR_NOMEM;
	}
	/* Even asleep a display shows its EDID: where none is, it has been moved. */
	if (status == BB_ERR_LOST && (fd < 0 || messages[0].address == EDID_ADDRESS))
		b->known = false;
	return status;
}

static void *work(void *ctx)
{
	struct bus_i2c *b = ctx;

	pthread_mutex_lock(&b->lock);
	for (;;) {
		while (b->job.state != JOB_ASKED && !b->over)
			pthread_cond_wait(&b->asked, &b->lock);
		if (b->over)
			break;
		pthread_mutex_unlock(&b->lock); /* nobody touches a job that is asked for */
		const enum bb_status status = carry_out(b, b->job.message, b->job.n);
		pthread_mutex_lock(&b->lock);
		b->job.status = status;
		b->job.n_reopened = b->n_reopened;
		b->job.state = JOB_DONE;
	}
	pthread_mutex_unlock(&b->lock);
	pthread_cond_destroy(&b->asked);
	pthread_mutex_destroy(&b->lock);
	free(b);
	return NULL;
}

/* ---- the seam ---- */

static bool is_the_job(const struct bus_i2c *b, const struct bb_i2c_message *messages, size_t n)
{
	bool same = n == b->job.n;

	for (size_t i = 0; i < n && same; i++) {
		const struct bb_i2c_message *m = &messages[i], *of_job = &b->job.message[i];
		same = m->address == of_job->address && m->read == of_job->read && m->n_bytes == of_job->n_bytes &&
		       (m->read || !memcmp(m->bytes, of_job->bytes, m->n_bytes));
	}
	return same;
}

static void ask_worker(struct bus_i2c *b, const struct bb_i2c_message *messages, size_t n)
{
	b->job.n = n;
	for (size_t i = 0; i < n; i++) {
		b->job.message[i] = messages[i];
		b->job.message[i].bytes = b->job.bytes[i];
		if (!messages[i].read)
			memcpy(b->job.bytes[i], messages[i].bytes, messages[i].n_bytes);
	}
	b->job.state = JOB_ASKED;
	pthread_cond_signal(&b->asked);
}

static enum bb_status take_result(struct bus_i2c *b, struct bb_i2c_message *messages, size_t n)
{
	for (size_t i = 0; i < n; i++)
		if (messages[i].read && b->job.status == BB_OK)
			memcpy(messages[i].bytes, b->job.bytes[i], messages[i].n_bytes);
	b->base.n_reopened = b->job.n_reopened;
	b->job.state = JOB_NONE;
	return b->job.status;
}

static enum bb_status transfer(struct bb_i2c_bus *bus, struct bb_i2c_message *messages, size_t n)
{
	struct bus_i2c *b = bb_container_of(bus, struct bus_i2c, base);
	enum bb_status status = BB_ERR_BUSY;

	if (!n || n > MOST_MESSAGES)
		return BB_ERR_USAGE;
	for (size_t i = 0; i < n; i++)
		if (!messages[i].n_bytes || messages[i].n_bytes > MOST_BYTES)
			return BB_ERR_USAGE;
	pthread_mutex_lock(&b->lock);
	if (b->job.state == JOB_DONE && is_the_job(b, messages, n))
		status = take_result(b, messages, n);
	else if (b->job.state != JOB_ASKED) /* the answer to a question nobody asks any more is forgotten */
		ask_worker(b, messages, n);
	pthread_mutex_unlock(&b->lock);
	return status;
}

static void close_bus(struct bb_i2c_bus *bus)
{
	struct bus_i2c *b = bb_container_of(bus, struct bus_i2c, base);

	pthread_mutex_lock(&b->lock);
	b->over = true;
	pthread_cond_signal(&b->asked);
	pthread_mutex_unlock(&b->lock);
}

static const struct bb_i2c_ops ops = { transfer, close_bus };

static enum bb_status start_worker(struct bus_i2c *b)
{
	pthread_attr_t attr;
	pthread_t thread;

	pthread_mutex_init(&b->lock, NULL);
	pthread_cond_init(&b->asked, NULL);
	if (pthread_attr_init(&attr))
		return BB_ERR_NOMEM;
	pthread_attr_setdetachstate(&attr, PTHREAD_CREATE_DETACHED);
	pthread_attr_setstacksize(&attr, STACK_BYTES);
	const int error = pthread_create(&thread, &attr, work, b);
	pthread_attr_destroy(&attr);
	return error ? BB_ERR_NOMEM : BB_OK;
}

static enum bb_status try_path(struct bus_i2c *b)
{
	const int fd = open(b->path, O_RDWR | O_CLOEXEC);
	enum bb_status status = fd >= 0 && is_i2c(fd) ? BB_OK : of_errno(errno);
	const int error = errno;

	if (fd >= 0) {
		b->known = identify(fd, &b->node);
		close(fd);
	}
	errno = error;
	return status;
}

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
	enum bb_status status = b->serial[0] ? BB_OK : try_path(b);
	const int error = errno;
	if (status == BB_OK)
		status = start_worker(b);
	if (status != BB_OK) {
		free(b);
		errno = error;
		return status;
	}
	*out = &b->base;
	return BB_OK;
}
