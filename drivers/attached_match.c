/* drivers/attached_match.c: a room's device against what is attached; why not, and what to do. */
#define _GNU_SOURCE
#include "drivers/attached.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <grp.h>
#include <netdb.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#define CONNECT_MS 300

static const struct scheme {
	const char *name, *dir, *absent, *load; /* the folder of the kernel's that is there when its part is loaded */
} schemes[] = {
	{ "gpio", "/sys/bus/gpio/devices", "the kernel knows no GPIO chip",
	  "load the driver of the chip, then look at `gpiodetect`" },
	{ "can", "/sys/class/net", "the kernel has no network", "modprobe can-raw, and the driver of the adapter" },
	{ "usb", "/sys/bus/usb/devices", "the kernel has no USB", "modprobe xhci_pci" },
	{ "hid", "/sys/class/hidraw", "the kernel has no hidraw", "modprobe hid-generic" },
	{ "evdev", "/sys/class/input", "the kernel has no input devices", "modprobe evdev" },
	{ "i2c", "/sys/class/i2c-dev", "i2c-dev is not loaded",
	  "modprobe i2c-dev (and name it in /etc/modules-load.d)" },
};

static const struct scheme *scheme_of(const char *name)
{
	for (size_t i = 0; i < BB_ARRAY_LEN(schemes); i++)
		if (!strcmp(schemes[i].name, name))
			return &schemes[i];
	return NULL;
}

static void say(struct bb_attached_answer *out, enum bb_attached_state state, const char *why, const char *remedy)
{
	out->state = state;
	snprintf(out->why, sizeof(out->why), "%s", why);
	snprintf(out->remedy, sizeof(out->remedy), "%s", remedy);
}

/* Whose is it, and what would let this process in? */
static void say_refused(const char *root, const char *node, struct bb_attached_answer *out)
{
	char path[400], why[160];
	struct stat st;
	struct group group, *found = NULL;
	char names[1024];

	snprintf(path, sizeof(path), "%s%s", root, node);
	if (stat(path, &st)) {
		snprintf(why, sizeof(why), "%s is not there, though the kernel has the device", node);
		say(out, BB_ATTACHED_REFUSED, why,
		    "start udev (`udevadm trigger`), or make the node: it is in a container without it");
		return;
	}
	getgrgid_r(st.st_gid, &group, names, sizeof(names), &found);
	snprintf(why, sizeof(why), "%s may not be used: it is owner %u, group %.40s, mode %04o", node,
		 (unsigned)st.st_uid, found ? group.gr_name : "unknown", (unsigned)st.st_mode & 07777);
	say(out, BB_ATTACHED_REFUSED, why,
	    "`make install` puts 70-blackburst.rules into udev; then `adduser USER blackburst`, log in again and "
	    "replug");
}

/* "046d:c218" and nothing else. */
static bool identity(const char *path, unsigned *vendor, unsigned *product)
{
	char *colon, *end;

	*vendor = (unsigned)strtoul(path, &colon, 16);
	*product = *colon == ':' ? (unsigned)strtoul(colon + 1, &end, 16) : 0;
	return colon - path == 4 && *colon == ':' && end - colon == 5 && !*end;
}

static const char *option(const struct bb_uri *uri, const char *key)
{
	for (size_t i = 0; i < uri->n_options; i++)
		if (!strcmp(uri->option[i].key, key))
			return uri->option[i].value;
	return NULL;
}

static bool is_it(const char *root, const struct bb_attached *a, const struct bb_uri *uri)
{
	const char *serial = option(uri, "serial");
	unsigned vendor, product;
	char path[400], real[4096];
	struct stat one, other;

	if (strcmp(a->scheme, uri->scheme))
		return false;
	if (!a->node[0]) /* an interface of the network */
		return !strcmp(a->device + strlen(a->scheme) + 1, uri->path);
	if (identity(uri->path, &vendor, &product))
		return a->vendor == vendor && a->product == product && (!serial || !strcmp(serial, a->serial));
	if (!strcmp(a->node, uri->path))
		return true;
	/* by another name: /dev/input/by-id/..., /dev/serial/... */
	snprintf(path, sizeof(path), "%s%s", root, uri->path);
	snprintf(real, sizeof(real), "%s%s", root, a->node);
	return stat(path, &one) == 0 && stat(real, &other) == 0 && one.st_rdev && one.st_rdev == other.st_rdev;
}

/* Nothing of the list is it: what would it be called, and what is there instead? */
static void say_missing(const char *root, const struct bb_attached *list, size_t n, const struct bb_uri *uri,
			struct bb_attached_answer *out)
{
	const struct scheme *s = scheme_of(uri->scheme);
	char path[400], why[200], others[120] = "";
	size_t same = 0;

	snprintf(path, sizeof(path), "%s%s", root, s->dir);
	if (access(path, F_OK)) {
		say(out, BB_ATTACHED_MISSING, s->absent, s->load);
		return;
	}
	for (size_t i = 0; i < n; i++) {
		if (strcmp(list[i].scheme, uri->scheme))
			continue;
		const size_t at = strlen(others);
		if (same++ < 3)
			snprintf(others + at, sizeof(others) - at, "%s%.36s", at ? ", " : "",
				 list[i].device + strlen(uri->scheme) + 1);
	}
	if (same)
		snprintf(why, sizeof(why), "not attached; there is %s%s", others, same > 3 ? " and more" : "");
	else
		snprintf(why, sizeof(why), "not attached, and nothing else of this kind is");
	say(out, BB_ATTACHED_MISSING, why,
	    !strcmp(uri->scheme, "can")   ? "plug the adapter in; `ip -details link show type can` lists them"
	    : !strcmp(uri->scheme, "i2c") ? "check the cable and that the display is on; `i2cdetect -l` lists the buses"
					  : "plug it in, switch it on; `dmesg` says what the kernel made of it");
}

static void say_down(const char *interface, struct bb_attached_answer *out)
{
	char remedy[160];

	snprintf(remedy, sizeof(remedy), "ip link set %.40s up%s", interface,
		 strncmp(interface, "vcan", 4) ? " type can bitrate 1000000 restart-ms 100" : "");
	say(out, BB_ATTACHED_REFUSED, "the interface is down", remedy);
}

/* ---- strips: on the network or a serial line ---- */

static int connect_error(const char *host, const char *port)
{
	const struct addrinfo want = { .ai_family = AF_UNSPEC, .ai_socktype = SOCK_STREAM, .ai_flags = AI_NUMERICSERV };
	struct addrinfo *found;
	int error = EHOSTUNREACH;

	if (getaddrinfo(host, port, &want, &found))
		return ENOENT;
	const int fd = socket(found->ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
	if (fd >= 0) {
		struct pollfd wait = { .fd = fd, .events = POLLOUT };
		socklen_t size = sizeof(error);
		error = connect(fd, found->ai_addr, found->ai_addrlen) ? errno : 0;
		if (error == EINPROGRESS) {
			error = ETIMEDOUT;
			if (poll(&wait, 1, CONNECT_MS) == 1)
				getsockopt(fd, SOL_SOCKET, SO_ERROR, &error, &size);
		}
		close(fd);
	}
	freeaddrinfo(found);
	return error;
}

static void match_tcp(const struct bb_uri *uri, struct bb_attached_answer *out)
{
	char host[96], why[160], *port;

	snprintf(host, sizeof(host), "%s", uri->path + strlen("tcp://"));
	port = strrchr(host, ':');
	if (port)
		*port++ = '\0';
	const int error = connect_error(host, port ? port : "502");
	if (!error)
		return;
	snprintf(why, sizeof(why), "%s:%s: %s", host, port ? port : "502",
		 error == ENOENT ? "no such host" : strerror(error));
	say(out, BB_ATTACHED_MISSING, why,
	    error == ECONNREFUSED ? "switch Modbus/TCP on in the strip's own pages, or correct the port"
				  : "check power, cable and address of the strip");
}

static void match_modbus(const char *root, const struct bb_uri *uri, struct bb_attached_answer *out)
{
	char path[400];

	if (!strncmp(uri->path, "tcp://", 6)) {
		match_tcp(uri, out);
	} else if (!strncmp(uri->path, "rtu:", 4)) {
		snprintf(path, sizeof(path), "%s%s", root, uri->path + 4);
		if (access(path, F_OK))
			say(out, BB_ATTACHED_MISSING, "no such serial port",
			    "plug the adapter in; `ls /dev/serial/by-id` lists them");
		else if (faccessat(AT_FDCWD, path, R_OK | W_OK, AT_EACCESS))
			say_refused(root, uri->path + 4, out);
	} else {
		say(out, BB_ATTACHED_MISSING, "neither tcp:// nor rtu:", "see docs/modbus.md");
	}
}

void bb_attached_match(const char *root, const struct bb_attached *list, size_t n, const struct bb_uri *uri,
		       struct bb_attached_answer *out)
{
	*out = (struct bb_attached_answer){ .state = BB_ATTACHED_HERE, .found = n };
	if (!strcmp(uri->scheme, "modbus")) {
		match_modbus(root, uri, out);
		return;
	}
	/* A display by its EDID's serial: somebody would have to read EDIDs. */
	if (!scheme_of(uri->scheme) || (!strcmp(uri->scheme, "i2c") && !uri->path[0])) {
		out->state = BB_ATTACHED_UNSEEN;
		return;
	}
	for (size_t i = 0; i < n && out->found == n; i++)
		if (is_it(root, &list[i], uri))
			out->found = i;
	if (out->found == n)
		say_missing(root, list, n, uri, out);
	else if (!list[out->found].usable && list[out->found].node[0])
		say_refused(root, list[out->found].node, out);
	else if (!list[out->found].usable)
		say_down(uri->path, out);
}
