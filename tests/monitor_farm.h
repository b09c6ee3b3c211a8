/*
 * tests/monitor_farm.h: monitors on real i2c adapters of a Linux kernel: sim/usb_monitor.h behind vhci-hcd, served by a
 * thread, so that the thread under test may block in the kernel. For a guest with vhci-hcd, i2c-tiny-usb and i2c-dev;
 * needs root. What belongs to a monitor (its peer, its faults, the world) is touched with the farm locked only, and
 * never with a transfer of one's own under way.
 */
#ifndef BB_TESTS_MONITOR_FARM_H
#define BB_TESTS_MONITOR_FARM_H

#include <dirent.h>
#include <errno.h>
#include <pthread.h>
#include <stdlib.h>
#include <sys/select.h>
#include <time.h>

#include "sim/usb_monitor.h"
#include "tests/guest/usb_vhci.h"

#define FARM_MOST 8
#define FARM_PORTS 8
#define FARM_WAIT_NS INT64_C(50000000)

struct farm {
	struct bb_clock *clk; /* both threads read it, neither runs it */
	struct usbip_server *server;
	pthread_mutex_t lock;
	pthread_t thread;
	int wake[2];
	bool over;
	size_t n;
	unsigned int next_port;
	struct farm_monitor {
		struct usb_monitor usb;
		size_t item;
		int fd; /* the server's end, to wait for; -1: not plugged in */
	} monitor[FARM_MOST];
};

static inline void farm_wake(struct farm *f)
{
	if (write(f->wake[1], "", 1) != 1)
		abort();
}

static inline void farm_lock(struct farm *f)
{
	pthread_mutex_lock(&f->lock);
}

static inline void farm_unlock(struct farm *f)
{
	pthread_mutex_unlock(&f->lock);
	farm_wake(f);
}

/* Returns when to come back. */
static inline int64_t farm_serve(struct farm *f)
{
	int64_t wake_ns = bb_clock_now_ns(f->clk) + FARM_WAIT_NS;

	usbip_server_step(f->server, 0);
	for (size_t i = 0; i < f->n; i++) {
		const int64_t due_ns = usb_monitor_step(&f->monitor[i].usb, bb_clock_now_ns(f->clk));
		wake_ns = due_ns < wake_ns ? due_ns : wake_ns;
	}
	return wake_ns;
}

static inline void *farm_run(void *ctx)
{
	struct farm *f = ctx;
	char byte;

	for (;;) {
		fd_set fds;
		int top = f->wake[0];
		FD_ZERO(&fds);
		FD_SET(top, &fds);
		pthread_mutex_lock(&f->lock);
		const int64_t wait_ns = farm_serve(f) - bb_clock_now_ns(f->clk);
		const bool over = f->over;
		for (size_t i = 0; i < f->n; i++)
			if (f->monitor[i].fd >= 0) {
				FD_SET(f->monitor[i].fd, &fds);
				top = f->monitor[i].fd > top ? f->monitor[i].fd : top;
			}
		pthread_mutex_unlock(&f->lock);
		if (over)
			return NULL;
		const struct timespec t = { .tv_nsec = wait_ns > 0 ? wait_ns : 0 };
		if (pselect(top + 1, &fds, NULL, NULL, &t, NULL) > 0 && FD_ISSET(f->wake[0], &fds) &&
		    read(f->wake[0], &byte, 1) != 1)
			return NULL;
	}
}

/* false: no vhci here. */
static inline bool farm_create(struct bb_clock *clk, struct farm **out)
{
	struct farm *f = calloc(1, sizeof(*f));

	*out = f;
	if (!f || !vhci_there() || pipe(f->wake) || usbip_server_create(clk, &f->server) != BB_OK)
		return false;
	f->clk = clk;
	pthread_mutex_init(&f->lock, NULL);
	return pthread_create(&f->thread, NULL, farm_run, f) == 0;
}

static inline void farm_destroy(struct farm *f)
{
	farm_lock(f);
	f->over = true;
	farm_unlock(f);
	pthread_join(f->thread, NULL);
	usbip_server_destroy(f->server);
	for (size_t i = 0; i < f->n; i++)
		usb_monitor_fini(&f->monitor[i].usb);
	close(f->wake[0]);
	close(f->wake[1]);
	free(f);
}

static inline bool farm_add(struct farm *f, const struct bb_monitor_config *config, struct sim_world *world, uint64_t seed)
{
	struct farm_monitor *m = &f->monitor[f->n];
	bool fine = f->n < FARM_MOST;

	farm_lock(f);
	m->fd = -1;
	fine = fine && usb_monitor_init(&m->usb, config, world, seed, f->clk) == BB_OK;
	fine = fine && usbip_server_export(f->server, usb_monitor_device(&m->usb), &m->item) == BB_OK;
	f->n += fine;
	farm_unlock(f);
	return fine;
}

/* Plugs it into a free port: each time another. */
static inline bool farm_plug(struct farm *f, size_t i)
{
	struct farm_monitor *m = &f->monitor[i];
	struct sim_usb_device *dev = usb_monitor_device(&m->usb);
	char text[64];
	int fd[2];

	if (socketpair(AF_UNIX, SOCK_STREAM, 0, fd))
		return false;
	farm_lock(f);
	usbip_server_plug(f->server, m->item, dev);
	const bool adopted = usbip_server_adopt(f->server, m->item, fd[0]) == BB_OK;
	m->fd = adopted ? fd[0] : -1;
	const unsigned int devid = usbip_server_devid(f->server, m->item);
	farm_unlock(f);
	bool told = false;
	for (int tries = 0; tries < FARM_PORTS && adopted && !told; tries++) { /* the last one may still be on its way out */
		snprintf(text, sizeof(text), "%u %d %u %d", f->next_port++ % FARM_PORTS, fd[1], devid, (int)dev->speed);
		told = vhci_write(VHCI "attach", text);
	}
	close(fd[1]); /* the kernel has its own hold on it */
	return told;
}

static inline void farm_unplug(struct farm *f, size_t i)
{
	farm_lock(f);
	f->monitor[i].fd = -1;
	usbip_server_withdraw(f->server, f->monitor[i].item);
	farm_unlock(f);
}

/* The i2c bus of the adapter with that serial number, "/dev/i2c-3"; false: there is none (yet). */
static inline bool farm_bus(const char *serial, char *out, size_t cap)
{
	DIR *dir = opendir("/sys/bus/i2c/devices");
	struct dirent *entry;
	char path[320], text[80];
	bool found = false;

	while (dir && !found && (entry = readdir(dir))) {
		if (strncmp(entry->d_name, "i2c-", 4))
			continue;
		snprintf(path, sizeof(path), "/sys/bus/i2c/devices/%s/device/../serial", entry->d_name);
		FILE *file = fopen(path, "re");
		found = file && fgets(text, sizeof(text), file) && !strncmp(text, serial, strlen(serial)) &&
			text[strlen(serial)] == '\n';
		if (file)
			fclose(file);
		snprintf(out, cap, "/dev/%.32s", entry->d_name);
		found = found && access(out, R_OK | W_OK) == 0;
	}
	if (dir)
		closedir(dir);
	return found;
}

/* The same, when it has come; within three seconds. */
static inline bool farm_wait_bus(const char *serial, char *out, size_t cap)
{
	for (int i = 0; i < 300; i++) {
		if (farm_bus(serial, out, cap))
			return true;
		const struct timespec t = { .tv_nsec = 10000000 };
		nanosleep(&t, NULL);
	}
	return false;
}

#endif
