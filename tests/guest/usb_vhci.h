/*
 * tests/guest/usb_vhci.h: the kernel's virtual USB host, told by its attach file. Header only; Linux with vhci-hcd.
 */
#ifndef BB_TESTS_GUEST_USB_VHCI_H
#define BB_TESTS_GUEST_USB_VHCI_H

#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "sim/usbip_server.h"

#define VHCI "/sys/devices/platform/vhci_hcd.0/"

static inline bool vhci_there(void)
{
	return access(VHCI "attach", W_OK) == 0;
}

static inline bool vhci_write(const char *file, const char *text)
{
	const int fd = open(file, O_WRONLY | O_CLOEXEC);
	const ssize_t n = fd < 0 ? -1 : write(fd, text, strlen(text));

	if (fd >= 0)
		close(fd);
	return n == (ssize_t)strlen(text);
}

/* Plugs an exported device into a port, over a socket pair. */
static inline bool vhci_attach(struct usbip_server *s, size_t item, const struct sim_usb_device *dev, unsigned port)
{
	char text[64];
	int fd[2];

	if (socketpair(AF_UNIX, SOCK_STREAM, 0, fd))
		return false;
	if (usbip_server_adopt(s, item, fd[0]) != BB_OK) {
		close(fd[0]);
		close(fd[1]);
		return false;
	}
	snprintf(text, sizeof(text), "%u %d %u %d", port, fd[1], usbip_server_devid(s, item), (int)dev->speed);
	const bool told = vhci_write(VHCI "attach", text);
	close(fd[1]); /* the kernel has its own hold on it */
	return told;
}

#endif
