/* sim/can_link.c: see sim/can_link.h. */
#include "sim/can_link.h"

#include <errno.h>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <linux/net_tstamp.h>
#include <linux/rtnetlink.h>
#include <net/if.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

struct sim_can_link {
	struct sim_can_wire wire;
	struct sim_can *can;
	struct bb_clock *clk;
	int fd;
};

static int64_t stamp_of(struct bb_clock *clk, struct msghdr *message)
{
	for (struct cmsghdr *h = CMSG_FIRSTHDR(message); h; h = CMSG_NXTHDR(message, h)) {
		struct timespec t;
		if (h->cmsg_level != SOL_SOCKET || h->cmsg_type != SO_TIMESTAMPING || h->cmsg_len < CMSG_LEN(sizeof(t)))
			continue;
		memcpy(&t, CMSG_DATA(h), sizeof(t)); /* the first of three: software */
		if (t.tv_sec || t.tv_nsec)
			return bb_clock_of_realtime_ns(clk, (int64_t)t.tv_sec * BB_NS_PER_S + t.tv_nsec);
	}
	return bb_clock_now_ns(clk);
}

static bool take(struct sim_can_link *l)
{
	struct can_frame raw;
	char control[256] __attribute__((aligned(8)));
	struct iovec place = { &raw, sizeof(raw) };
	struct msghdr message = { .msg_iov = &place, .msg_iovlen = 1, .msg_control = control,
		                  .msg_controllen = sizeof(control) };

	const ssize_t n = recvmsg(l->fd, &message, MSG_DONTWAIT);
	if (n < 0)
		return errno == EINTR;
	if (n != (ssize_t)CAN_MTU || raw.len > 8 || raw.can_id & CAN_ERR_FLAG)
		return true;
	struct bb_can_frame f = { .extended = raw.can_id & CAN_EFF_FLAG, .remote = raw.can_id & CAN_RTR_FLAG,
		                  .n_bytes = raw.len };
	f.id = raw.can_id & (f.extended ? CAN_EFF_MASK : CAN_SFF_MASK);
	memcpy(f.bytes, raw.data, raw.len);
	f.at_ns = stamp_of(l->clk, &message);
	if (message.msg_flags & MSG_CONFIRM)
		sim_can_wire_sent(l->can, &f, f.at_ns);
	else
		sim_can_wire_heard(l->can, &f, f.at_ns);
	return true;
}

void sim_can_link_serve(struct sim_can_link *l)
{
	for (int i = 0; i < 256 && take(l); i++) /* a bus gone mad does not hold the loop */
		;
}

static bool link_send(struct sim_can_wire *wire, const struct bb_can_frame *f)
{
	struct sim_can_link *l = bb_container_of(wire, struct sim_can_link, wire);
	struct can_frame raw = { .can_id = f->id | (f->extended ? CAN_EFF_FLAG : 0) | (f->remote ? CAN_RTR_FLAG : 0),
		                 .len = f->n_bytes };

	if (f->error) /* only others hear those: it is sent when it is written */
		raw.can_id = f->id | CAN_ERR_FLAG;
	memcpy(raw.data, f->bytes, sizeof(raw.data));
	const bool written = write(l->fd, &raw, sizeof(raw)) == (ssize_t)sizeof(raw);
	const bool down = !written && (errno == ENETDOWN || errno == ENODEV || errno == ENXIO);
	if (!written && !down)
		return false;
	if (f->error || down) /* without the host the others go on among themselves */
		sim_can_wire_sent(l->can, f, bb_clock_now_ns(l->clk));
	sim_can_link_serve(l); /* a virtual bus has sent it already */
	return true;
}

static enum bb_status open_socket(struct sim_can_link *l, const char *name, struct bb_error *err)
{
	const int on = 1, stamps = SOF_TIMESTAMPING_RX_SOFTWARE | SOF_TIMESTAMPING_SOFTWARE;
	struct sockaddr_can address = { .can_family = AF_CAN, .can_ifindex = (int)if_nametoindex(name) };
	struct ifreq r = { 0 };

	memcpy(r.ifr_name, name, strlen(name) + 1);
	l->fd = socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW);
	if (l->fd < 0 && (errno == EAFNOSUPPORT || errno == EPROTONOSUPPORT))
		return bb_fail(err, BB_ERR_UNSUPPORTED, 1530, NULL, "%s: no CAN sockets (%s)", name, strerror(errno));
	if (l->fd < 0)
		return bb_fail(err, BB_ERR_IO, 1533, NULL, "%s: %s", name, strerror(errno));
	if (!address.can_ifindex)
		return bb_fail(err, BB_ERR_LOST, 1531, NULL, "%s", name);
	if (ioctl(l->fd, SIOCGIFFLAGS, &r) < 0 || !(r.ifr_flags & IFF_UP))
		return bb_fail(err, BB_ERR_LOST, 1532, NULL, "%s is down", name);
	/* Without its own frames it would never know that they were sent: that one must work. */
	if (setsockopt(l->fd, SOL_CAN_RAW, CAN_RAW_RECV_OWN_MSGS, &on, sizeof(on)) < 0 ||
	    setsockopt(l->fd, SOL_SOCKET, SO_TIMESTAMPING, &stamps, sizeof(stamps)) < 0 ||
	    bind(l->fd, (struct sockaddr *)&address, sizeof(address)) < 0)
		return bb_fail(err, BB_ERR_IO, 1533, NULL, "%s: %s", name, strerror(errno));
	return BB_OK;
}

enum bb_status sim_can_link_open(const char *interface, struct sim_can *can, struct bb_clock *clk,
                                 struct sim_can_link **out, struct bb_error *err)
{
	*out = NULL;
	if (!*interface || strlen(interface) >= IFNAMSIZ)
		return bb_fail(err, BB_ERR_CONFIG, 1531, NULL, "\"%.40s\" is no interface's name", interface);
	struct sim_can_link *l = calloc(1, sizeof(*l));
	if (!l)
		return BB_ERR_NOMEM;
	*l = (struct sim_can_link){ .wire = { link_send }, .can = can, .clk = clk };
	const enum bb_status status = open_socket(l, interface, err);
	if (status != BB_OK) {
		sim_can_link_close(l);
		return status;
	}
	sim_can_use_wire(can, &l->wire);
	*out = l;
	return BB_OK;
}

void sim_can_link_close(struct sim_can_link *l)
{
	if (!l)
		return;
	if (l->fd >= 0)
		close(l->fd);
	free(l);
}

int sim_can_link_fd(const struct sim_can_link *l)
{
	return l->fd;
}

/* ---- what an interface is: its kind, as `ip -details link` shows it ---- */

static const struct rtattr *attribute(const void *from, size_t n, unsigned short type)
{
	for (const struct rtattr *a = from; RTA_OK(a, n); a = RTA_NEXT(a, n))
		if ((a->rta_type & NLA_TYPE_MASK) == type)
			return a;
	return NULL;
}

static bool kind_is_virtual(const struct nlmsghdr *h, size_t n)
{
	if (n < NLMSG_LENGTH(sizeof(struct ifinfomsg)) || h->nlmsg_type != RTM_NEWLINK || h->nlmsg_len > n)
		return false;
	const struct ifinfomsg *info = NLMSG_DATA(h);
	const struct rtattr *link = attribute(IFLA_RTA(info), IFLA_PAYLOAD(h), IFLA_LINKINFO);
	const struct rtattr *kind = link ? attribute(RTA_DATA(link), RTA_PAYLOAD(link), IFLA_INFO_KIND) : NULL;

	return kind && ((RTA_PAYLOAD(kind) == sizeof("vcan") && !memcmp(RTA_DATA(kind), "vcan", sizeof("vcan"))) ||
	                (RTA_PAYLOAD(kind) == sizeof("vxcan") && !memcmp(RTA_DATA(kind), "vxcan", sizeof("vxcan"))));
}

bool sim_can_link_is_virtual(const char *interface)
{
	struct {
		struct nlmsghdr head;
		struct ifinfomsg info;
	} ask = { { .nlmsg_len = sizeof(ask), .nlmsg_type = RTM_GETLINK, .nlmsg_flags = NLM_F_REQUEST },
		  { .ifi_index = (int)if_nametoindex(interface) } };
	union {
		struct nlmsghdr head;
		char bytes[8192];
	} answer;
	const int fd = ask.info.ifi_index ? socket(AF_NETLINK, SOCK_RAW | SOCK_CLOEXEC, NETLINK_ROUTE) : -1;

	if (fd < 0)
		return false;
	const ssize_t n = send(fd, &ask, sizeof(ask), 0) < 0 ? -1 : recv(fd, &answer, sizeof(answer), 0);
	close(fd);
	return n > 0 && kind_is_virtual(&answer.head, (size_t)n);
}
