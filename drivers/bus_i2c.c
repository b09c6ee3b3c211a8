/* drivers/bus_i2c.c: see drivers/bus_i2c.h; the kernel's Documentation/i2c/dev-interface. */
#include "drivers/bus_i2c.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/ioctl.h>
#include <unistd.h>

#include <linux/i2c-dev.h>
#include <linux/i2c.h>

#define MOST_MESSAGES 4

struct bus_i2c {
	struct bb_i2c_bus base;
	int fd; /* -1: to be opened again */
	bool plain;
	char path[96];
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

static enum bb_status connect_fd(struct bus_i2c *b)
{
	unsigned long functions = 0;

	b->fd = open(b->path, O_RDWR | O_CLOEXEC);
	if (b->fd < 0)
		return of_errno(errno);
	if (ioctl(b->fd, I2C_FUNCS, &functions) == 0 && (functions & I2C_FUNC_I2C))
		return BB_OK;
	if (functions)
		errno = EOPNOTSUPP;
	const int error = errno;
	close(b->fd);
	b->fd = -1;
	errno = error;
	return BB_ERR_UNSUPPORTED;
}

static enum bb_status transfer_plain(struct bus_i2c *b, const struct bb_i2c_message *m)
{
	if (ioctl(b->fd, I2C_SLAVE, (unsigned long)m->address) < 0)
		return of_errno(errno);
	const ssize_t n = m->read ? read(b->fd, m->bytes, m->n_bytes) : write(b->fd, m->bytes, m->n_bytes);
	if (n < 0)
		return of_errno(errno);
	return n == m->n_bytes ? BB_OK : BB_ERR_IO;
}

static enum bb_status transfer_rdwr(struct bus_i2c *b, struct bb_i2c_message *messages, size_t n)
{
	struct i2c_msg raw[MOST_MESSAGES];
	struct i2c_rdwr_ioctl_data all = { .msgs = raw, .nmsgs = (unsigned int)n };

	for (size_t i = 0; i < n; i++)
		raw[i] = (struct i2c_msg){ .addr = messages[i].address,
					   .flags = messages[i].read ? I2C_M_RD : 0,
					   .len = messages[i].n_bytes,
					   .buf = messages[i].bytes };
	const int done = ioctl(b->fd, I2C_RDWR, &all);
	if (done < 0)
		return of_errno(errno);
	return done == (int)n ? BB_OK : BB_ERR_IO;
}

static enum bb_status transfer(struct bb_i2c_bus *bus, struct bb_i2c_message *messages, size_t n)
{
	struct bus_i2c *b = bb_container_of(bus, struct bus_i2c, base);
	enum bb_status status = BB_OK;

	if (!n || n > MOST_MESSAGES)
		return BB_ERR_USAGE;
	if (b->fd < 0)
		status = connect_fd(b);
	if (status != BB_OK)
		return status == BB_ERR_NOMEM ? status : BB_ERR_LOST;
	if (b->plain)
		for (size_t i = 0; i < n && status == BB_OK; i++)
			status = transfer_plain(b, &messages[i]);
	else
		status = transfer_rdwr(b, messages, n);
	/* An adapter that was pulled out answers EIO or ENODEV on the old descriptor for ever; its node may be back. */
	if (status == BB_ERR_IO || (status == BB_ERR_LOST && errno == ENODEV)) {
		close(b->fd);
		b->fd = -1;
	}
	return status;
}

static void close_bus(struct bb_i2c_bus *bus)
{
	struct bus_i2c *b = bb_container_of(bus, struct bus_i2c, base);

	if (b->fd >= 0)
		close(b->fd);
	free(b);
}

static const struct bb_i2c_ops ops = { transfer, close_bus };

enum bb_status bus_i2c_open(const char *path, bool plain, struct bb_clock *clk, struct bb_i2c_bus **out)
{
	struct bus_i2c *b = calloc(1, sizeof(*b));

	*out = NULL;
	if (!b)
		return BB_ERR_NOMEM;
	b->base = (struct bb_i2c_bus){ .ops = &ops, .clk = clk };
	b->plain = plain;
	snprintf(b->path, sizeof(b->path), "%s", path);
	const enum bb_status status = connect_fd(b);
	if (status != BB_OK) {
		const int error = errno;
		free(b);
		errno = error;
		return status;
	}
	*out = &b->base;
	return BB_OK;
}
