/*
 * drivers/link/shm.c: packets through memory that processes of one machine share. The head makes a nameless file that
 * the others open by "/proc/PID/fd/N" (the kernel lets only its owner), with two rings of slots for every process: each
 * has one writer and one reader, so that one killed in the middle of a write leaves nothing half said. A process sleeps
 * on a futex, its bell. What stands in the memory is believed no more than a datagram.
 */
#define _GNU_SOURCE
#include "drivers/link/peers.h"

#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <linux/futex.h>
#include <poll.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#define MAGIC 0x6d687362U /* "bshm" */
#define SLOTS 64

struct slot {
	uint32_t n;
	uint8_t bytes[LINK_PACKET_MAX];
};

struct ring {
	_Atomic uint32_t written, read; /* counted, never wrapped back */
	struct slot slot[SLOTS];
};

struct seat { /* of one process */
	_Atomic uint32_t bell;     /* futex: rung when something was written for it */
	_Atomic uint32_t asleep;
	_Atomic uint32_t pid;      /* who sits here */
	struct ring up, down;      /* to and from the head */
};

struct region {
	uint32_t magic, n_processes, slot_bytes, slots;
	struct seat seat[];
};

struct link_shm {
	struct link_peers peers;
	int fd;
	size_t n_bytes;
	struct region *region;
	uint16_t n, me;               /* seats; mine */
	uint16_t turn;                /* whose ring the head reads next */
	uint32_t written[LINK_PROCESSES_MAX], read[LINK_PROCESSES_MAX]; /* of the rings that are mine to write or read */
	int pidfd[LINK_PROCESSES_MAX]; /* -1: none */
};

static struct link_shm *own(struct link_peers *l)
{
	return bb_container_of(l, struct link_shm, peers);
}

static bool is_head(const struct link_shm *s)
{
	return s->me == 0;
}

static size_t region_bytes(uint16_t n)
{
	return sizeof(struct region) + n * sizeof(struct seat);
}

/* ---- bells ---- */

static void ring_bell(struct seat *seat)
{
	atomic_fetch_add(&seat->bell, 1);
	if (atomic_load(&seat->asleep))
		syscall(SYS_futex, &seat->bell, FUTEX_WAKE, INT_MAX, NULL, NULL, 0);
}

static bool anything(const struct link_shm *s)
{
	const unsigned first = is_head(s) ? 1 : s->me, end = is_head(s) ? s->n : s->me + 1U;

	for (unsigned i = first; i < end; i++) {
		const struct ring *r = is_head(s) ? &s->region->seat[i].up : &s->region->seat[i].down;
		if (atomic_load(&r->written) != s->read[i])
			return true;
	}
	return false;
}

static void wire_wait(struct link_peers *l, int64_t until_ns)
{
	struct link_shm *s = own(l);
	struct seat *seat = &s->region->seat[s->me];
	const struct timespec t = { .tv_sec = until_ns / BB_NS_PER_S, .tv_nsec = until_ns % BB_NS_PER_S };
	const uint32_t bell = atomic_load(&seat->bell);

	atomic_store(&seat->asleep, 1);
	if (!anything(s)) /* FUTEX_WAIT_BITSET takes an absolute CLOCK_MONOTONIC time */
		syscall(SYS_futex, &seat->bell, FUTEX_WAIT_BITSET, bell, &t, NULL, FUTEX_BITSET_MATCH_ANY);
	atomic_store(&seat->asleep, 0);
}

/* ---- packets ---- */

static uint16_t seat_of(const struct link_shm *s, const struct link_address *far)
{
	return is_head(s) ? (uint16_t)(far->bytes[0] % s->n) : s->me;
}

static bool pid_gone(struct link_shm *s, uint16_t i)
{
	struct pollfd p = { .fd = s->pidfd[i], .events = POLLIN };

	return s->pidfd[i] >= 0 && poll(&p, 1, 0) == 1;
}

static bool wire_alive(struct link_peers *l, const struct link_address *far)
{
	struct link_shm *s = own(l);

	return !pid_gone(s, is_head(s) ? seat_of(s, far) : 0);
}

static enum bb_status wire_send(struct link_peers *l, const struct link_address *to, const uint8_t *bytes, size_t n)
{
	struct link_shm *s = own(l);
	const uint16_t i = seat_of(s, to);
	struct ring *r = is_head(s) ? &s->region->seat[i].down : &s->region->seat[i].up;
	struct slot *slot = &r->slot[s->written[i] % SLOTS];

	if (!is_head(s) && pid_gone(s, 0))
		return BB_ERR_LOST;
	if (s->written[i] - atomic_load(&r->read) >= SLOTS)
		return BB_ERR_BUSY;
	memcpy(slot->bytes, bytes, n);
	slot->n = (uint32_t)n;
	atomic_store(&r->written, ++s->written[i]);
	ring_bell(&s->region->seat[is_head(s) ? i : 0]);
	return BB_OK;
}

static size_t take(struct link_shm *s, uint16_t i, uint8_t *bytes, size_t cap)
{
	struct ring *r = is_head(s) ? &s->region->seat[i].up : &s->region->seat[i].down;
	const uint32_t written = atomic_load(&r->written);

	if (written == s->read[i])
		return 0;
	if (written - s->read[i] > SLOTS) /* not what a writer of ours leaves behind */
		s->read[i] = written - 1;
	const struct slot *slot = &r->slot[s->read[i] % SLOTS];
	const uint32_t said = *(const volatile uint32_t *)&slot->n; /* once: it may change under our eyes */
	const size_t n = said && said <= sizeof(slot->bytes) ? said : 1;
	memcpy(bytes, slot->bytes, n < cap ? n : cap);
	atomic_store(&r->read, ++s->read[i]);
	return n;
}

static size_t wire_receive(struct link_peers *l, struct link_address *from, uint8_t *bytes, size_t cap)
{
	struct link_shm *s = own(l);
	size_t n;

	*from = (struct link_address){ .n = 1 };
	if (!is_head(s))
		return take(s, s->me, bytes, cap);
	for (uint16_t k = 1; k < s->n; k++) { /* one after the other: a loud one cannot shut out the rest */
		s->turn = (uint16_t)(s->turn % (s->n - 1) + 1);
		n = take(s, s->turn, bytes, cap);
		from->bytes[0] = (uint8_t)s->turn;
		if (n)
			return n;
	}
	return 0;
}

static int open_pid(uint32_t pid)
{
	return pid ? (int)syscall(SYS_pidfd_open, pid, 0) : -1;
}

static void wire_joined(struct link_peers *l, const struct link_address *far, uint32_t pid)
{
	struct link_shm *s = own(l);
	const uint16_t i = seat_of(s, far);

	if (s->pidfd[i] >= 0)
		close(s->pidfd[i]);
	s->pidfd[i] = open_pid(pid);
}

static const struct link_wire_ops wire = { wire_send, wire_receive, wire_alive, wire_wait, wire_joined };

/* ---- open ---- */

static enum bb_status fail(struct link_shm *s, const char *what)
{
	return bb_device_fail(&s->peers.base.dev, errno == EACCES || errno == ENOENT ? BB_ERR_LOST : BB_ERR_IO, "open",
	                      "%s: %s", what, strerror(errno));
}

static enum bb_status map(struct link_shm *s)
{
	void *at = mmap(NULL, s->n_bytes, PROT_READ | PROT_WRITE, MAP_SHARED, s->fd, 0);

	if (at == MAP_FAILED)
		return fail(s, "mapping the shared memory");
	s->region = at;
	return BB_OK;
}

static enum bb_status make(struct link_shm *s)
{
	s->n_bytes = region_bytes(s->n);
	s->fd = memfd_create("blackburst-link", MFD_CLOEXEC | MFD_ALLOW_SEALING);
	if (s->fd < 0 || fchmod(s->fd, 0600) || ftruncate(s->fd, (off_t)s->n_bytes) ||
	    fcntl(s->fd, F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_SEAL) < 0)
		return fail(s, "making shared memory");
	const enum bb_status status = map(s);
	if (status != BB_OK)
		return status;
	s->region->magic = MAGIC;
	s->region->n_processes = s->n;
	s->region->slot_bytes = sizeof(struct slot);
	s->region->slots = SLOTS;
	atomic_store(&s->region->seat[0].pid, (uint32_t)getpid());
	snprintf(s->peers.address, sizeof(s->peers.address), "shm:/proc/%d/fd/%d", (int)getpid(), s->fd);
	return BB_OK;
}

/* Takes its seat, or the first whose owner is gone. */
static bool sit(struct link_shm *s, uint16_t i)
{
	uint32_t was = atomic_load(&s->region->seat[i].pid);

	if (was) {
		const int fd = open_pid(was);
		struct pollfd p = { .fd = fd, .events = POLLIN };
		const bool there = fd >= 0 ? poll(&p, 1, 0) == 0 : errno != ESRCH;
		if (fd >= 0)
			close(fd);
		if (there)
			return false;
	}
	if (!atomic_compare_exchange_strong(&s->region->seat[i].pid, &was, (uint32_t)getpid()))
		return false;
	s->me = i;
	s->written[i] = atomic_load(&s->region->seat[i].up.written);
	s->read[i] = atomic_load(&s->region->seat[i].down.written);
	atomic_store(&s->region->seat[i].down.read, s->read[i]); /* or a ring its last owner left full stays full */
	return true;
}

static enum bb_status find(struct link_shm *s, const char *path)
{
	struct stat st;
	struct region head;

	s->fd = open(path, O_RDWR | O_CLOEXEC);
	if (s->fd < 0 || fstat(s->fd, &st))
		return fail(s, path);
	/* A seal against shrinking, or the maker could take the memory away under a reader. */
	if (pread(s->fd, &head, sizeof(head), 0) != (ssize_t)sizeof(head) || head.magic != MAGIC || head.slots != SLOTS ||
	    head.slot_bytes != sizeof(struct slot) || head.n_processes != s->n ||
	    (uint64_t)st.st_size != region_bytes(s->n) || !(fcntl(s->fd, F_GET_SEALS) & F_SEAL_SHRINK))
		return bb_device_fail(&s->peers.base.dev, BB_ERR_FORMAT, "open", "not the memory of a head with %u processes", s->n);
	s->n_bytes = (size_t)st.st_size;
	const enum bb_status status = map(s);
	if (status != BB_OK)
		return status;
	s->pidfd[0] = open_pid(atomic_load(&s->region->seat[0].pid));
	const uint16_t wanted = s->peers.group.process;
	for (uint16_t i = wanted == BB_LINK_ANY ? 1 : wanted; i < s->n && (wanted == BB_LINK_ANY || i == wanted); i++)
		if (sit(s, i)) {
			s->peers.group.process = i;
			return BB_OK;
		}
	return bb_device_fail(&s->peers.base.dev, BB_ERR_BUSY, "open", "every seat is taken");
}

static void shm_close(struct bb_link *l)
{
	struct link_shm *s = own(bb_container_of(l, struct link_peers, base));

	link_peers_close(&s->peers);
	if (s->region && !is_head(s))
		atomic_store(&s->region->seat[s->me].pid, 0);
	if (s->region)
		munmap(s->region, s->n_bytes);
	if (s->fd >= 0)
		close(s->fd);
	for (size_t i = 0; i < BB_ARRAY_LEN(s->pidfd); i++)
		if (s->pidfd[i] >= 0)
			close(s->pidfd[i]);
}

static enum bb_status shm_open_link(struct bb_link *l, const struct bb_open *open)
{
	struct link_shm *s = own(bb_container_of(l, struct link_peers, base));

	s->fd = -1;
	memset(s->pidfd, 0xff, sizeof(s->pidfd));
	enum bb_status status = link_peers_open(&s->peers, &wire);
	s->n = s->peers.group.n_processes;
	if (status == BB_OK && s->n > 1)
		status = link_peers_is_head(&s->peers) ? make(s) : find(s, open->uri->path);
	if (status != BB_OK)
		shm_close(l);
	return status;
}

static const struct bb_link_ops ops = { shm_open_link, shm_close, link_peers_send, link_peers_receive, link_peers_notify };
const struct bb_link_driver link_shm_driver = { "shm", sizeof(struct link_shm), &ops };
