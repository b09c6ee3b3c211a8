/*
 * tests/guest/monitors.c: our DDC driver on the kernel's i2c buses.
 *   monitors numbers GETS     how long a VCP get takes and how many tries, on a clean display and on each with a quirk
 *   monitors replugs REPLUGS  two displays whose adapters are pulled out and come back as other buses, in the other order,
 *                             while they are asked; found again by the serial in their EDID
 *   monitors with COMMAND     two displays while COMMAND runs; it is told the bus of one, the EDID's serial of the other
 * Each prints its table and one JSON line; exit 0 fine, 1 not, 77 no vhci.
 */
#include "drivers/edid.h"
#include "tests/guest/monitor_stage.h"
#include "tests/monitor_numbers.h"

#include <sys/wait.h>

/* ---- numbers ---- */

static int numbers(size_t gets)
{
	static struct numbers v;
	struct stage s = { 0 };
	char bus[64];
	unsigned int wrong = 0;

	NEED(gets >= 8 && gets <= NUMBERS_MOST);
	stage_begin(&s);
	stage_add(&s, "numbers", "S27A850D");
	stage_plug(&s, 0, bus, sizeof(bus));
	numbers_head();
	char *json = NULL;
	size_t n_json = 0;
	FILE *line = open_memstream(&json, &n_json);
	NEED(line);
	for (size_t k = 0; k < BB_ARRAY_LEN(numbers_displays); k++) {
		const struct numbers_display *d = &numbers_displays[k];
		struct bb_monitor *m = stage_open_bus(&s, bus);
		farm_lock(s.farm);
		*peer_ddcci_quirks(s.farm->monitor[0].usb.monitor) = d->quirks;
		farm_unlock(s.farm);
		numbers_measure(&v, m, s.rig->clk, RIG_MS, gets);
		bb_monitor_close(m);
		numbers_print(d, &v);
		wrong += v.wrong + (v.mean_tries > d->most_mean + 0.1); /* fewer gets than on the virtual clock */
		fprintf(line, ",\"%s_p50_ns\":%lld,\"%s_p99_ns\":%lld,\"%s_max_ns\":%lld,\"%s_tries\":%.3f", d->key,
			(long long)v.ns[v.n / 2], d->key, (long long)v.ns[v.n * 99 / 100], d->key, (long long)v.ns[v.n - 1],
			d->key, v.mean_tries);
	}
	const struct peer_counts counts = stage_counts(&s, 0);
	wrong += counts.too_early + counts.damaged + counts.saves != 0;
	stage_end(&s);
	fclose(line);
	printf("{\"test\":\"monitor_numbers\",\"gets\":%zu,\"wrong\":%u%s}\n", gets, wrong, json);
	free(json);
	return wrong != 0;
}

/* ---- replugs ---- */

#define BETWEEN_NS (13 * RIG_S) /* five a minute are no fault */

struct plugs {
	struct stage s;
	struct bb_monitor *m[2];
	char bus[2][64], serial[2][16];
	unsigned long moved, wrong;
	int64_t lost_most_ns, back_most_ns;
};

static long resident_kib(void)
{
	char line[128];
	long kib = -1;
	FILE *f = fopen("/proc/self/status", "re");

	while (f && fgets(line, sizeof(line), f))
		if (sscanf(line, "VmRSS: %ld", &kib) == 1)
			break;
	if (f)
		fclose(f);
	return kib;
}

static void expect(struct plugs *p, bool holds, const char *what, unsigned long round)
{
	if (holds)
		return;
	p->wrong++;
	printf("round %lu: %s\n", round, what);
}

/* Asks until the answer is of that kind; how long that took. */
static int64_t until(struct plugs *p, int i, bool there)
{
	const int64_t start_ns = rig_now(p->s.rig);

	while ((stage_ask(&p->s, p->m[i], BB_MONITOR_GET, BB_VCP_LUMINANCE, 0).status == BB_OK) != there)
		NEED(rig_now(p->s.rig) - start_ns < 20 * RIG_S);
	return rig_now(p->s.rig) - start_ns;
}

static void check_identity(struct plugs *p, int i, unsigned long round)
{
	const uint16_t value = (uint16_t)((round * 7 + (unsigned long)i * 50) % 101);
	const struct bb_monitor_reply r = stage_ask(&p->s, p->m[i], BB_MONITOR_EDID, 0, 0);
	struct edid_info e = { 0 };
	bool has;

	expect(p, r.status == BB_OK && edid_parse(r.edid, r.edid_bytes, &e) == BB_OK, "no EDID", round);
	expect(p, !strcmp(e.serial_text, p->serial[i]), "another's EDID", round);
	expect(p, stage_ask(&p->s, p->m[i], BB_MONITOR_SET, BB_VCP_LUMINANCE, value).status == BB_OK, "no write", round);
	expect(p, stage_truth(&p->s, (size_t)i, BB_VCP_LUMINANCE, &has) == value, "the write went elsewhere", round);
}

/* Plugged in in either order, so that the kernel gives them each other's numbers. */
static void plug_both(struct plugs *p, unsigned long round)
{
	for (unsigned long k = 0; k < 2; k++) {
		const unsigned long i = (k + round) % 2;
		char before[64];
		snprintf(before, sizeof(before), "%s", p->bus[i]);
		stage_plug(&p->s, i, p->bus[i], sizeof(p->bus[i]));
		p->moved += before[0] && strcmp(before, p->bus[i]) != 0;
	}
}

static void unplug_both(struct plugs *p, unsigned long round)
{
	const struct bb_monitor_request q = { BB_MONITOR_CAPABILITIES, 0, 0 };

	for (int i = 0; i < 2; i++) /* in the middle of something */
		NEED(bb_monitor_submit(p->m[i], &q) == BB_OK);
	rig_pass(p->s.rig, (int64_t)(20 + 37 * (round % 8)) * RIG_MS);
	for (size_t i = 0; i < 2; i++)
		farm_unplug(p->s.farm, i);
	for (int i = 0; i < 2; i++) {
		struct bb_monitor_reply r;
		while (bb_monitor_poll(p->m[i], &r) == BB_TIMEOUT)
			rig_pass(p->s.rig, 2 * RIG_MS);
		const int64_t ns = until(p, i, false);
		p->lost_most_ns = ns > p->lost_most_ns ? ns : p->lost_most_ns;
	}
	char path[64];
	expect(p, !farm_bus("left", path, sizeof(path)) && !farm_bus("right", path, sizeof(path)), "its bus is still there",
	       round);
}

static void round_trip(struct plugs *p, unsigned long round)
{
	plug_both(p, round);
	for (int i = 0; i < 2; i++) {
		const int64_t ns = until(p, i, true);
		p->back_most_ns = ns > p->back_most_ns ? ns : p->back_most_ns;
		check_identity(p, i, round);
	}
	unplug_both(p, round);
	rig_pass(p->s.rig, BETWEEN_NS);
}

/* Between two questions the other display takes over the bus: its node has the same name, and it is not the one. */
static void swap(struct plugs *p)
{
	bool has;

	stage_plug(&p->s, 0, p->bus[0], sizeof(p->bus[0]));
	(void)until(p, 0, true);
	const uint16_t before = stage_truth(&p->s, 1, BB_VCP_CONTRAST, &has);
	farm_unplug(p->s.farm, 0);
	for (char path[64]; farm_bus("left", path, sizeof(path));)
		rig_pass(p->s.rig, RIG_MS);
	stage_plug(&p->s, 1, p->bus[1], sizeof(p->bus[1]));
	expect(p, !strcmp(p->bus[0], p->bus[1]), "not the same name", 0);
	expect(p, stage_ask(&p->s, p->m[0], BB_MONITOR_SET, BB_VCP_CONTRAST, 3).status == BB_ERR_LOST, "took another for it", 0);
	expect(p, stage_truth(&p->s, 1, BB_VCP_CONTRAST, &has) == before, "wrote to another", 0);
	farm_unplug(p->s.farm, 1);
	rig_pass(p->s.rig, BETWEEN_NS);
}

/* One round after the other without a pause: left alone, until a hand lifts it. */
static void flap(struct plugs *p)
{
	const struct ddc_health *h = &monitor_ddc_report(p->m[0])->health;
	int plugs = 0;

	while (h->health != BB_HEALTH_QUARANTINED && plugs < 10) {
		stage_plug(&p->s, 0, p->bus[0], sizeof(p->bus[0]));
		plugs++;
		for (int tries = 0; tries < 20 && h->health != BB_HEALTH_QUARANTINED; tries++)
			if (stage_ask(&p->s, p->m[0], BB_MONITOR_GET, BB_VCP_LUMINANCE, 0).status == BB_OK)
				break;
		farm_unplug(p->s.farm, 0);
		rig_pass(p->s.rig, 500 * RIG_MS);
	}
	expect(p, h->health == BB_HEALTH_QUARANTINED && h->fault == DDC_FAULT_FLAPS, "flaps, and is not quarantined", 0);
	stage_plug(&p->s, 0, p->bus[0], sizeof(p->bus[0]));
	expect(p, stage_ask(&p->s, p->m[0], BB_MONITOR_GET, BB_VCP_LUMINANCE, 0).status == BB_ERR_IO, "asked in quarantine", 0);
	monitor_ddc_release(p->m[0]);
	(void)until(p, 0, true);
	expect(p, h->health != BB_HEALTH_QUARANTINED, "released", 0);
	printf("BUS_FLAPS after %d plugs; released by hand\n", plugs);
	farm_unplug(p->s.farm, 0);
}

static int replugs(unsigned long rounds)
{
	static const char *const ids[2] = { "left", "right" };
	struct plugs p = { 0 };
	long fds = 0, kib = 0;

	stage_begin(&p.s);
	for (size_t i = 0; i < 2; i++) {
		struct edid_info e;
		char uri[64];
		stage_add(&p.s, ids[i], "S27A850D");
		stage_plug(&p.s, i, p.bus[i], sizeof(p.bus[i]));
		struct bb_monitor *m = stage_open_bus(&p.s, p.bus[i]);
		const struct bb_monitor_reply r = stage_ask(&p.s, m, BB_MONITOR_EDID, 0, 0);
		bb_monitor_close(m);
		NEED(r.status == BB_OK && edid_parse(r.edid, r.edid_bytes, &e) == BB_OK);
		snprintf(p.serial[i], sizeof(p.serial[i]), "%s", e.serial_text);
		snprintf(uri, sizeof(uri), "i2c:?serial=%s", e.serial_text);
		p.m[i] = stage_open(&p.s, uri);
	}
	unplug_both(&p, 0);
	for (unsigned long round = 1; round <= rounds; round++) {
		round_trip(&p, round);
		if (round == 1) {
			fds = descriptors();
			kib = resident_kib();
		}
	}
	const long more_fds = descriptors() - fds, more_kib = resident_kib() - kib;
	expect(&p, more_fds == 0, "descriptors leak", rounds);
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__) /* they keep what is freed */
	expect(&p, more_kib < 512, "memory leaks", rounds);
#endif
	expect(&p, p.moved > 0, "nothing came back as another bus", rounds);
	swap(&p);
	flap(&p);
	for (int i = 0; i < 2; i++)
		bb_monitor_close(p.m[i]);
	stage_end(&p.s);
	printf("{\"test\":\"monitor_replugs\",\"replugs\":%lu,\"as_another_bus\":%lu,\"lost_max_ms\":%.1f,\"back_max_ms\":%.1f,"
	       "\"fds\":%ld,\"kib\":%ld,\"wrong\":%lu}\n",
	       2 * rounds, p.moved, (double)p.lost_most_ns * 1e-6, (double)p.back_most_ns * 1e-6, more_fds, more_kib, p.wrong);
	return p.wrong != 0;
}

/* ---- with ---- */

/* Two displays, one under each's bus, for somebody else's program. */
static int with(const char *command)
{
	static const char *const ids[2] = { "left", "right" };
	struct stage s = { 0 };
	char bus[2][64], line[256];

	stage_begin(&s);
	for (size_t i = 0; i < 2; i++) {
		stage_add(&s, ids[i], "S27A850D");
		stage_plug(&s, i, bus[i], sizeof(bus[i]));
	}
	struct bb_monitor *m = stage_open_bus(&s, bus[1]);
	const struct bb_monitor_reply r = stage_ask(&s, m, BB_MONITOR_EDID, 0, 0);
	struct edid_info e;
	NEED(edid_parse(r.edid, r.edid_bytes, &e) == BB_OK);
	bb_monitor_close(m);
	snprintf(line, sizeof(line), "%.100s %.32s %.16s", command, bus[0], e.serial_text);
	const int status = system(line);
	stage_end(&s);
	return WIFEXITED(status) ? WEXITSTATUS(status) : 1;
}

int main(int argc, char **argv)
{
	const unsigned long n = argc > 2 ? strtoul(argv[2], NULL, 10) : 0;

	if (argc == 3 && !strcmp(argv[1], "numbers"))
		return numbers(n);
	if (argc == 3 && !strcmp(argv[1], "replugs") && n)
		return replugs(n);
	if (argc == 3 && !strcmp(argv[1], "with"))
		return with(argv[2]);
	fprintf(stderr, "usage: monitors numbers GETS | replugs REPLUGS | with COMMAND\n");
	return 2;
}
