/*
 * drivers/bus_can.c: SocketCAN raw sockets: non-blocking, with error frames and SO_TIMESTAMPING. Software stamps are
 * CLOCK_REALTIME; a hardware stamp is in the controller's own clock, so only its software companion is used for now.
 */
#include "drivers/bus_can.h"
#include "drivers/canopen_wire.h"

#include <errno.h>
#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/netlink.h>
#include <linux/can/raw.h>
#include <linux/net_tstamp.h>
#include <linux/rtnetlink.h>
#include <net/if.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

_Static_assert(CAN_CLASS_BUS_OFF == CAN_ERR_BUSOFF && CAN_CLASS_CONTROLLER == CAN_ERR_CRTL &&
                       CAN_CLASS_RESTARTED == CAN_ERR_RESTARTED && CAN_CLASS_COUNTERS == CAN_ERR_CNT &&
                       CAN_CLASS_NO_ACK == CAN_ERR_ACK && CAN_CLASS_BUS_ERROR == CAN_ERR_BUSERROR &&
                       CAN_CLASS_PROTOCOL == CAN_ERR_PROT,
               "error classes are the kernel's");
_Static_assert(CAN_STATE_TX_PASSIVE == CAN_ERR_CRTL_TX_PASSIVE && CAN_STATE_RX_PASSIVE == CAN_ERR_CRTL_RX_PASSIVE &&
                       CAN_STATE_TX_WARNING == CAN_ERR_CRTL_TX_WARNING && CAN_STATE_ACTIVE == CAN_ERR_CRTL_ACTIVE,
               "controller states are the kernel's");

struct can_socket {
	struct bb_can_bus bus;
	int fd, link_fd; /* link_fd: netlink, opened at the first restart; -1 */
	int index;
	char name[IFNAMSIZ];
};

static struct can_socket *own(struct bb_can_bus *bus)
{
	return bb_container_of(bus, struct can_socket, bus);
}

static bool is_down(struct can_socket *c)
{
	struct ifreq r = { 0 };

	memcpy(r.ifr_name, c->name, sizeof(c->name));
	return ioctl(c->fd, SIOCGIFFLAGS, &r) < 0 || !(r.ifr_flags & IFF_UP);
}

/* A kernel forgets a socket's filters, the one that lets everything in as well, when the interface goes away. */
static enum bb_status bind_to(struct can_socket *c)
{
	const struct sockaddr_can address = { .can_family = AF_CAN, .can_ifindex = c->index };
	const struct can_filter all = { 0, 0 };

	if (setsockopt(c->fd, SOL_CAN_RAW, CAN_RAW_FILTER, &all, sizeof(all)) < 0)
		return BB_ERR_LOST;
	return bind(c->fd, (const struct sockaddr *)&address, sizeof(address)) < 0 ? BB_ERR_LOST : BB_OK;
}

/* An adapter that was pulled and put back has its old name and a new index. */
static enum bb_status link_up(struct can_socket *c)
{
	struct ifreq r = { 0 };

	memcpy(r.ifr_name, c->name, sizeof(c->name));
	if (ioctl(c->fd, SIOCGIFINDEX, &r) < 0 || is_down(c)) /* if_nametoindex would open a socket at each look */
		return BB_ERR_LOST;
	if (r.ifr_ifindex == c->index)
		return BB_OK;
	c->index = r.ifr_ifindex;
	return bind_to(c);
}

static enum bb_status socket_send(struct bb_can_bus *bus, const struct bb_can_frame *f)
{
	struct can_socket *c = own(bus);
	struct can_frame raw = { .can_id = f->id | (f->extended ? CAN_EFF_FLAG : 0) | (f->remote ? CAN_RTR_FLAG : 0) };

	if (f->n_bytes > 8 || f->error || f->id > (f->extended ? CAN_EFF_MASK : CAN_SFF_MASK))
		return BB_ERR_USAGE;
	raw.len = f->n_bytes;
	memcpy(raw.data, f->bytes, f->n_bytes);
	if (write(c->fd, &raw, sizeof(raw)) == (ssize_t)sizeof(raw))
		return BB_OK;
	switch (errno) {
	case ENOBUFS:
	case EAGAIN:
	case EINTR:
		return BB_ERR_BUSY;
	case ENETDOWN:
	case ENODEV:
	case ENXIO:
		return BB_ERR_LOST;
	default:
		return BB_ERR_IO;
	}
}

static int64_t stamp_of(const struct bb_can_bus *bus, struct msghdr *message)
{
	struct {
		struct timespec ts[3]; /* software, nothing, raw hardware: struct scm_timestamping */
	} stamps;

	for (struct cmsghdr *h = CMSG_FIRSTHDR(message); h; h = CMSG_NXTHDR(message, h)) {
		if (h->cmsg_level != SOL_SOCKET || h->cmsg_type != SO_TIMESTAMPING ||
		    h->cmsg_len < CMSG_LEN(sizeof(stamps)))
			continue;
		memcpy(&stamps, CMSG_DATA(h), sizeof(stamps));
		const int64_t ns = (int64_t)stamps.ts[0].tv_sec * BB_NS_PER_S + stamps.ts[0].tv_nsec;
		if (ns)
			return bb_clock_of_realtime_ns(bus->clk, ns);
	}
	return bb_clock_now_ns(bus->clk);
}

static enum bb_status socket_receive(struct bb_can_bus *bus, struct bb_can_frame *f)
{
	struct can_socket *c = own(bus);
	struct can_frame raw;
	char control[256] __attribute__((aligned(8)));
	struct iovec place = { &raw, sizeof(raw) };
	struct msghdr message = { .msg_iov = &place, .msg_iovlen = 1, .msg_control = control,
		                  .msg_controllen = sizeof(control) };

	const ssize_t n = recvmsg(c->fd, &message, MSG_DONTWAIT);
	if (n < 0)
		return errno == EAGAIN || errno == EINTR ? (link_up(c) == BB_OK ? BB_TIMEOUT : BB_ERR_LOST)
		       : errno == ENETDOWN || errno == ENODEV ? BB_ERR_LOST
		                                              : BB_ERR_IO;
	if (n != (ssize_t)CAN_MTU || raw.len > 8)
		return BB_ERR_IO;
	memset(f, 0, sizeof(*f));
	f->error = raw.can_id & CAN_ERR_FLAG;
	f->extended = raw.can_id & CAN_EFF_FLAG;
	f->remote = raw.can_id & CAN_RTR_FLAG;
	f->id = raw.can_id & (f->error ? CAN_ERR_MASK : f->extended ? CAN_EFF_MASK : CAN_SFF_MASK);
	f->n_bytes = raw.len;
	memcpy(f->bytes, raw.data, raw.len);
	f->at_ns = stamp_of(bus, &message);
	return BB_OK;
}

/* Netlink: "ip link set NAME type can restart". */

struct restart_request {
	struct nlmsghdr head;
	struct ifinfomsg info;
	char attributes[64];
};

static struct rtattr *attribute(struct restart_request *r, unsigned short type, const void *data, size_t n)
{
	struct rtattr *a = (struct rtattr *)(void *)((char *)r + NLMSG_ALIGN(r->head.nlmsg_len));

	a->rta_type = type;
	a->rta_len = (unsigned short)RTA_LENGTH(n);
	if (n)
		memcpy(RTA_DATA(a), data, n);
	r->head.nlmsg_len = (uint32_t)(NLMSG_ALIGN(r->head.nlmsg_len) + RTA_ALIGN(a->rta_len));
	return a;
}

static void close_nest(struct restart_request *r, struct rtattr *a)
{
	a->rta_len = (unsigned short)((char *)r + r->head.nlmsg_len - (char *)a);
}

static enum bb_status socket_restart(struct bb_can_bus *bus)
{
	struct can_socket *c = own(bus);
	struct restart_request r = { .head = { .nlmsg_len = NLMSG_LENGTH(sizeof(struct ifinfomsg)),
		                               .nlmsg_type = RTM_NEWLINK, .nlmsg_flags = NLM_F_REQUEST | NLM_F_ACK },
		                     .info = { .ifi_index = c->index } };
	struct {
		struct nlmsghdr head;
		struct nlmsgerr error;
		char rest[256];
	} answer;
	const uint32_t one = 1;

	if (c->link_fd < 0)
		c->link_fd = socket(AF_NETLINK, SOCK_RAW | SOCK_CLOEXEC, NETLINK_ROUTE);
	if (c->link_fd < 0)
		return BB_ERR_UNSUPPORTED;
	struct rtattr *outer = attribute(&r, IFLA_LINKINFO, NULL, 0);
	attribute(&r, IFLA_INFO_KIND, "can", 3);
	struct rtattr *inner = attribute(&r, IFLA_INFO_DATA, NULL, 0);
	attribute(&r, IFLA_CAN_RESTART, &one, sizeof(one));
	close_nest(&r, inner);
	close_nest(&r, outer);
	if (send(c->link_fd, &r, r.head.nlmsg_len, 0) < 0)
		return BB_ERR_IO;
	const ssize_t n = recv(c->link_fd, &answer, sizeof(answer), MSG_DONTWAIT); /* the kernel answers within the send */
	if (n < (ssize_t)NLMSG_LENGTH(sizeof(struct nlmsgerr)) || answer.head.nlmsg_type != NLMSG_ERROR)
		return BB_ERR_IO;
	switch (answer.error.error) {
	case 0:
		return BB_OK;
	case -EBUSY:
		return BB_ERR_BUSY;
	default: /* EPERM without CAP_NET_ADMIN, EOPNOTSUPP of a virtual link, EINVAL when restart-ms is set */
		return BB_ERR_UNSUPPORTED;
	}
}

static void socket_close(struct bb_can_bus *bus)
{
	struct can_socket *c = own(bus);

	if (c->link_fd >= 0)
		close(c->link_fd);
	if (c->fd >= 0)
		close(c->fd);
	free(c);
}

static void ask_for_stamps(int fd)
{
	const int flags = SOF_TIMESTAMPING_RX_SOFTWARE | SOF_TIMESTAMPING_SOFTWARE;
	const can_err_mask_t errors = CAN_ERR_MASK;
	const int room = 1 << 20;

	/* Without one of these it still works, with coarser stamps or a later notice of bus-off. */
	(void)setsockopt(fd, SOL_SOCKET, SO_TIMESTAMPING, &flags, sizeof(flags));
	(void)setsockopt(fd, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof(errors));
	(void)setsockopt(fd, SOL_SOCKET, SO_RCVBUF, &room, sizeof(room));
}

static enum bb_status open_socket(struct can_socket *c, struct bb_error *err)
{
	c->fd = socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW);
	if (c->fd < 0 && (errno == EAFNOSUPPORT || errno == EPROTONOSUPPORT))
		return bb_fail(err, BB_ERR_UNSUPPORTED, 1530, NULL, "%s: no CAN sockets (%s)", c->name, strerror(errno));
	if (c->fd < 0)
		return bb_fail(err, BB_ERR_IO, 1533, NULL, "%s: %s", c->name, strerror(errno));
	c->index = (int)if_nametoindex(c->name);
	if (!c->index)
		return bb_fail(err, BB_ERR_LOST, 1531, NULL, "%s: %s", c->name, strerror(errno));
	if (is_down(c))
		return bb_fail(err, BB_ERR_LOST, 1532, NULL, "%s is down", c->name);
	ask_for_stamps(c->fd);
	if (bind_to(c) != BB_OK)
		return bb_fail(err, BB_ERR_IO, 1533, NULL, "%s: bind: %s", c->name, strerror(errno));
	return BB_OK;
}

enum bb_status bb_can_bus_open(const char *interface, struct bb_clock *clk, struct bb_can_bus **out,
                               struct bb_error *err)
{
	static const struct bb_can_ops ops = { socket_send, socket_receive, socket_restart, socket_close };

	*out = NULL;
	if (!*interface || strlen(interface) >= IFNAMSIZ)
		return bb_fail(err, BB_ERR_CONFIG, 1531, NULL, "\"%.40s\" is no interface's name", interface);
	struct can_socket *c = calloc(1, sizeof(*c));
	if (!c)
		return BB_ERR_NOMEM;
	c->bus = (struct bb_can_bus){ &ops, clk, 0 };
	c->fd = c->link_fd = -1;
	snprintf(c->name, sizeof(c->name), "%s", interface);
	const enum bb_status status = open_socket(c, err);
	if (status != BB_OK) {
		socket_close(&c->bus);
		return status;
	}
	*out = &c->bus;
	return BB_OK;
}
