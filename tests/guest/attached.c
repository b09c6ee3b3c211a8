/*
 * tests/guest/attached.c: what drivers/attached.h says of a real sysfs, and what our udev rules made of the nodes: a
 * RumblePad 2 by uhid besides whatever modules the case has loaded. usage: attached [URI=STATE[,GROUP:MODE]]...
 * where STATE is here, missing or refused; the group and mode are those of the node, as `stat -c %G:%a` has them.
 */
#include "drivers/attached.h"
#include "sim/uhid.h"
#include "tests/guest/measure.h"

#include <grp.h>
#include <sys/stat.h>
#include <unistd.h>

static struct bb_attached list[64];
static size_t n;

static void check_node(const struct bb_attached *a, const char *want)
{
	struct stat st;
	char have[80];

	NEED(stat(a->node, &st) == 0);
	const struct group *g = getgrgid(st.st_gid);
	snprintf(have, sizeof(have), "%s:%o", g ? g->gr_name : "?", st.st_mode & 07777);
	printf("%s %s\n", a->node, have);
	if (strcmp(have, want)) {
		printf("%s is %s, not %s\n", a->node, have, want);
		exit(1);
	}
}

static void check(char *row)
{
	static const char *const words[] = { [BB_ATTACHED_HERE] = "here", [BB_ATTACHED_MISSING] = "missing",
		                             [BB_ATTACHED_REFUSED] = "refused", [BB_ATTACHED_UNSEEN] = "unseen" };
	struct bb_attached_answer a;
	struct bb_uri uri;
	char *want = strrchr(row, '=');

	NEED(want);
	*want++ = '\0';
	char *node = strchr(want, ',');
	if (node)
		*node++ = '\0';
	NEED(bb_uri_parse(row, &uri, NULL, NULL) == BB_OK);
	bb_attached_match("", list, n, &uri, &a);
	printf("%s: %s%s%s%s%s\n", row, words[a.state], a.why[0] ? ", " : "", a.why, a.remedy[0] ? " -> " : "", a.remedy);
	if (strcmp(words[a.state], want)) {
		printf("should be %s\n", want);
		exit(1);
	}
	if (node) {
		NEED(a.found < n);
		check_node(&list[a.found], node);
	}
}

int main(int argc, char **argv)
{
	struct sim_peer_config config = { .kind = SIM_PEER_RUMBLEPAD2_WIRED, .id = "S7", .script = "" };
	struct sim_peer_pad *pad;
	struct sim_uhid *uhid;

	NEED(bb_clock_posix_create(&config.clk) == BB_OK);
	NEED(sim_peer_pad_create(&config, &pad) == BB_OK);
	NEED(sim_uhid_create(pad, &uhid) == BB_OK);
	for (int i = 0; i < 50; i++, pause_ns(10000000)) /* udev names it */
		(void)!sim_uhid_step(uhid);
	n = bb_attached_list("", list, BB_ARRAY_LEN(list));
	for (size_t i = 0; i < n; i++)
		printf("%-36s %-18s %s\n", list[i].device, list[i].node, list[i].what);
	for (int i = 1; i < argc; i++)
		check(argv[i]);
	sim_uhid_destroy(uhid);
	sim_peer_pad_destroy(pad);
	bb_clock_destroy(config.clk);
	return 0;
}
