/* tests/test_faults.c: the grammar, its errors, files, planting, overlap, and that every verb does as its row says. */
#include "tests/fixture_room.h"

#include <unistd.h>

static struct sim_fault parsed(const char *text)
{
	struct bb_error err = { 0 };
	struct sim_fault f;

	if (sim_fault_parse(text, &f, NULL, &err) != BB_OK)
		fail_msg("%s", err.text);
	return f;
}

static void reads_what_people_write(void **state)
{
	struct sim_fault f = parsed("at 2.0s camera/c3 cover for 3s");

	(void)state;
	assert_string_equal(f.class_name, "camera");
	assert_string_equal(f.id, "c3");
	assert_string_equal(f.verb, "cover");
	assert_int_equal(f.at_ns, 2 * BB_NS_PER_S);
	assert_int_equal(f.for_ns, 3 * BB_NS_PER_S);
	assert_int_equal(f.for_frames, 0);
	assert_false(f.at_boot);
	f = parsed("at 0s shutter/chain stage_offset stage=left us=900");
	assert_int_equal(f.args.n, 2);
	assert_string_equal(sim_fault_arg(&f.args, "stage"), "left");
	assert_int_equal(f.for_ns, BB_NEVER);
	assert_null(f.args.where);
	f = parsed(" at\t3s  node/right late frames=1 for 20 frames ");
	assert_int_equal(f.for_frames, 20);
	assert_int_equal(f.for_ns, BB_NEVER);
	f = parsed("at boot node/left slow ms=2.5 for 250ms");
	assert_true(f.at_boot);
	assert_int_equal(f.for_ns, 250 * MS);
	f = parsed("at 0.5ms camera/c1 drop percent=1e1 for 70us");
	assert_int_equal(f.at_ns, 500000);
	assert_int_equal(f.for_ns, 70000);
}

static const struct {
	const char *text;
	int number;
	const char *says;
} bad[] = {
	{ "", 1601, "at TIME" },
	{ "cover camera/c1 at 2s", 1601, "at TIME" },
	{ "at 2s camera/c1", 1601, "at TIME" },
	{ "at 2s camera cover", 1601, "CLASS/ID" },
	{ "at 2s camera/ cover", 1601, "CLASS/ID" },
	{ "at 2s /c1 cover", 1601, "CLASS/ID" },
	{ "at 2s camera/c1 cover a=1 b=2 c=3 d=4 e=5 f=6 g=7 h=8 i=9 j=1 k=2 l=3 m=4", 1601, "words" },
	{ "at 2s kamera/c1 cover", 1602, "camera" },
	{ "at 2s camera/c1 covre", 1602, "did you mean \"cover\"" },
	{ "at 2s camera/c1 explode", 1602, "cover" },
	{ "at 2s abcdefghijklmnopqrstuvwxyz/c1 cover", 1602, "no class" },
	{ "at 2 camera/c1 cover", 1603, "no time" },
	{ "at -1s camera/c1 cover", 1603, "no time" },
	{ "at nans camera/c1 cover", 1603, "no time" },
	{ "at infs camera/c1 cover", 1603, "no time" },
	{ "at 0x10s camera/c1 cover", 1603, "no time" },
	{ "at 1e300s camera/c1 cover", 1603, "no time" },
	{ "at s camera/c1 cover", 1603, "no time" },
	{ "at 1s camera/c1 cover for", 1603, "no duration" },
	{ "at 1s camera/c1 cover for 0s", 1603, "no duration" },
	{ "at 1s camera/c1 cover for 3", 1603, "no duration" },
	{ "at 1s camera/c1 cover for 2.5 frames", 1603, "no duration" },
	{ "at 1s camera/c1 cover for 20 frames please", 1603, "no duration" },
	{ "at 1s camera/c1 cover for 3s hard=1", 1603, "no duration" },
	{ "at 1s camera/abcdefghijklmnopqrstuvwxyzabcdefghijk cover", 1604, "bytes" },
	{ "at 1s camera/c1 cover now", 1605, "key=value" },
	{ "at 1s camera/c1 cover x=1", 1605, "no argument" },
	{ "at 1s camera/c1 drop", 1605, "missing" },
	{ "at 1s camera/c1 drop percent=", 1605, "key=value" },
	{ "at 1s camera/c1 drop percent=lots", 1605, "no number" },
	{ "at 1s camera/c1 drop percent=nan", 1605, "no number" },
	{ "at 1s camera/c1 drop percent=0x5", 1605, "no number" },
	{ "at 1s camera/c1 drop percent=1e999", 1605, "no number" },
	{ "at 1s camera/c1 drop percent=101", 1605, "outside" },
	{ "at 1s camera/c1 drop percent=-1", 1605, "outside" },
	{ "at 1s camera/c1 drop percent=1 percent=2", 1605, "twice" },
	{ "at 1s shutter/chain stage_offset us=900", 1605, "stage=ID" },
	{ "at 1s shutter/chain stage_offset stage=left", 1605, "us=N" },
};

static void refuses_the_rest_with_a_number(void **state)
{
	const struct bb_where where = { "faults.txt", 12, 3 };

	(void)state;
	for (size_t i = 0; i < BB_ARRAY_LEN(bad); i++) {
		struct bb_error err = { 0 };
		struct sim_fault f;
		assert_int_equal(sim_fault_parse(bad[i].text, &f, &where, &err), BB_ERR_CONFIG);
		if (err.number != bad[i].number || !strstr(err.text, bad[i].says) ||
		    !strstr(err.text, "faults.txt:12:3"))
			fail_msg("%s: %s", bad[i].text, err.text);
	}
}

static void very_long_and_random_texts_are_refused_in_peace(void **state)
{
	static const char alphabet[] = "at 2s camera/c1 cover for frames=N0.e-\t\x01\xff/";
	struct sim_rng r;
	char text[300];

	(void)state;
	sim_rng_seed(&r, 9, "test", "fuzz");
	for (int i = 0; i < 20000; i++) {
		struct bb_error err = { 0 };
		struct sim_fault f;
		const size_t n = sim_rng_u64(&r) % (sizeof(text) - 1);
		for (size_t k = 0; k < n; k++)
			text[k] = alphabet[sim_rng_u64(&r) % (sizeof(alphabet) - 1)];
		text[n] = '\0';
		assert_true(sim_fault_parse(text, &f, NULL, &err) == BB_OK || err.number / 100 == 16);
	}
}

/* Files */

static char *write_file(const char *bytes, size_t n)
{
	static char path[] = "/tmp/bb_faults_XXXXXX";

	memcpy(path + sizeof(path) - 7, "XXXXXX", 6);
	const int fd = mkstemp(path);
	assert_true(fd >= 0);
	assert_int_equal(write(fd, bytes, n), (ssize_t)n);
	close(fd);
	return path;
}

static void a_file_has_one_a_line(void **state)
{
	static const char text[] =
		"# a comment\n\n  at 1s camera/c1 cover  # why not\r\nat 2s node/left crash\nat 3s camera/c2 dark";
	const char *path = write_file(text, sizeof(text) - 1);
	struct sim_fault *f;
	struct bb_error err = { 0 };
	size_t n;

	(void)state;
	assert_int_equal(sim_fault_file(path, &f, &n, &err), BB_OK);
	assert_int_equal(n, 3);
	assert_string_equal(f[0].text, "at 1s camera/c1 cover");
	assert_string_equal(f[2].verb, "dark");
	free(f);
	unlink(path);
}

static void assert_file_fails(const char *bytes, size_t n, int number, const char *says)
{
	const char *path = write_file(bytes, n);
	struct sim_fault *f;
	struct bb_error err = { 0 };
	size_t n_out;

	assert_int_equal(sim_fault_file(path, &f, &n_out, &err), BB_ERR_CONFIG);
	unlink(path);
	assert_null(f);
	assert_int_equal(n_out, 0);
	assert_int_equal(err.number, number);
	if (!strstr(err.text, says))
		fail_msg("%s", err.text);
}

static void broken_files_are_refused_with_their_line(void **state)
{
	static const char wrong[] = "at 1s camera/c1 cover\n\n  at 2s camera/c1 covet\n";
	const size_t many = 4097, line = sizeof("at 0s node/a crash\n") - 1;
	char *big = malloc((1 << 20) + 2);
	struct bb_error err = { 0 };
	struct sim_fault *f;
	size_t n;

	(void)state;
	assert_non_null(big);
	assert_file_fails(wrong, sizeof(wrong) - 1, 1602, ":3:3");
	assert_file_fails("at 0s node/a crash\n\0at", 22, 1601, "NUL");
	memset(big, '#', (1 << 20) + 1);
	assert_file_fails(big, (1 << 20) + 1, 1003, "bytes");
	for (size_t i = 0; i < many; i++)
		memcpy(big + i * line, "at 0s node/a crash\n", line);
	assert_file_fails(big, many * line, 1607, ":4097:");
	memset(big, 'a', 1000);
	assert_file_fails(big, 1000, 1601, ":1:1");
	free(big);
	assert_int_equal(sim_fault_file("/nonexistent/faults", &f, &n, &err), BB_ERR_CONFIG);
	assert_int_equal(err.number, 1001);
	err.number = 0;
	assert_int_equal(sim_fault_file("/", &f, &n, &err), BB_ERR_CONFIG);
	assert_int_equal(err.number, 1002);
}

/* Planting */

struct live {
	struct rig rig;
	struct bb_shutter *shutter;
	struct bb_camera *camera;
	struct bb_display *display;
	struct bb_link *link;
};

static void live_init(struct live *l)
{
	rig_init(&l->rig, 1, 1);
	l->shutter = rig_shutter(&l->rig);
	l->camera = rig_camera(&l->rig, 0);
	l->display = rig_display(&l->rig, 0);
	l->link = rig_link(&l->rig);
	assert_int_equal(bb_shutter_set_mode(l->shutter, BB_SHUTTER_STEREO), BB_OK);
	assert_int_equal(bb_camera_start(l->camera), BB_OK);
}

static void live_done(struct live *l)
{
	bb_shutter_close(l->shutter);
	bb_camera_close(l->camera);
	bb_display_close(l->display);
	bb_link_close(l->link);
	rig_done(&l->rig);
}

/* Events of faults seen so far as "0+ 1+ 0-", with their times checked for order. */
static void fault_story(struct live *l, char *out, size_t cap)
{
	int64_t last_ns = 0;

	*out = '\0';
	bb_eventlog_flush(l->rig.log);
	for (size_t i = 0; i < l->rig.n_events; i++) {
		const struct bb_event *e = &l->rig.event[i];
		if (e->kind != BB_EV_FAULT)
			continue;
		assert_true(e->at_ns >= last_ns);
		last_ns = e->at_ns;
		snprintf(out + strlen(out), cap - strlen(out), "%s%lld%c", *out ? " " : "", (long long)e->a,
		         e->b ? '+' : '-');
	}
}

static void faults_are_set_cleared_and_may_overlap(void **state)
{
	const struct sim_fault f[] = {
		parsed("at 100ms node/left late frames=2 for 100ms"),
		parsed("at 150ms node/left late frames=1 for 100ms"),
		parsed("at 150ms node/left slow ms=3"),
		parsed("at boot node/front crash for 3 frames"),
		parsed("at 9s camera/c1 cover"),
	};
	struct sim_fault_state s;
	struct live l;
	char story[64];

	(void)state;
	live_init(&l);
	rig_run(&l.rig, 20 * MS);
	assert_int_equal(sim_faults_plant(l.rig.world, f, BB_ARRAY_LEN(f), 10 * MS, NULL), BB_OK);
	assert_int_equal(sim_faults_plant(l.rig.world, f, 1, 10 * MS, NULL), BB_ERR_USAGE);
	assert_true(sim_world_node_dead(l.rig.world, 1, 0));
	sim_world_set_scene_start(l.rig.world, 1000 * MS);
	assert_int_equal(sim_faults_start(l.rig.world), BB_OK);
	bb_clock_run_until(l.rig.clk, 50 * MS);
	assert_false(sim_world_node_dead(l.rig.world, 1, 0));
	bb_clock_run_until(l.rig.clk, 1100 * MS);
	assert_int_equal(sim_world_node_delay_ns(l.rig.world, 2, 1100 * MS), 20 * MS);
	bb_clock_run_until(l.rig.clk, 1150 * MS);
	assert_int_equal(sim_world_node_delay_ns(l.rig.world, 2, 1150 * MS), 33 * MS);
	bb_clock_run_until(l.rig.clk, 1200 * MS);
	assert_int_equal(sim_world_node_delay_ns(l.rig.world, 2, 1200 * MS), 13 * MS);
	bb_clock_run_until(l.rig.clk, 2000 * MS);
	assert_int_equal(sim_world_node_delay_ns(l.rig.world, 2, 2000 * MS), 3 * MS);
	fault_story(&l, story, sizeof(story));
	assert_string_equal(story, "3+ 3- 0+ 1+ 2+ 0- 1-");
	assert_true(sim_fault_state(l.rig.world, 0, &s));
	assert_int_equal(s.set_ns, 1100 * MS);
	assert_int_equal(s.cleared_ns, 1200 * MS);
	assert_int_equal(s.status, BB_OK);
	assert_true(sim_fault_state(l.rig.world, 3, &s));
	assert_int_equal(s.cleared_ns - s.set_ns, 30 * MS);
	assert_true(sim_fault_state(l.rig.world, 4, &s));
	assert_int_equal(s.set_ns, BB_NEVER);
	assert_false(sim_fault_state(l.rig.world, 5, &s));
	live_done(&l);
}

static void planting_names_what_is_wrong(void **state)
{
	static const struct {
		const char *text;
		int number;
	} wrong[] = {
		{ "at 1s camera/c9 cover", 1604 },     { "at 1s node/nobody crash", 1604 },
		{ "at 1s camera/c2 cover", 1606 },     { "at boot display/left unplug", 1606 },
		{ "at 1s shutter/chain stuck stage=roof", 1605 },
		{ "at 1s link/net partition node=roof", 1605 },
		{ "at 1s world/elsewhere leave", 1604 },
	};
	struct live l;

	(void)state;
	live_init(&l);
	for (size_t i = 0; i < BB_ARRAY_LEN(wrong); i++) {
		const struct sim_fault f[2] = { parsed("at boot node/left crash"), parsed(wrong[i].text) };
		struct bb_error err = { 0 };
		assert_int_equal(sim_faults_plant(l.rig.world, f, 2, 10 * MS, &err), BB_ERR_CONFIG);
		if (err.number != wrong[i].number || !strstr(err.text, wrong[i].text))
			fail_msg("%s", err.text);
		assert_false(sim_world_node_dead(l.rig.world, 2, 0)); /* nothing of a bad plan is set */
	}
	live_done(&l);
}

static void a_closed_device_is_reported_not_touched(void **state)
{
	const struct sim_fault f = parsed("at 1s camera/c1 cover");
	struct sim_fault_state s;
	struct live l;

	(void)state;
	live_init(&l);
	assert_int_equal(sim_faults_plant(l.rig.world, &f, 1, 10 * MS, NULL), BB_OK);
	assert_int_equal(sim_faults_start(l.rig.world), BB_OK);
	bb_camera_close(l.camera);
	l.camera = NULL;
	rig_run(&l.rig, 2 * BB_NS_PER_S);
	assert_true(sim_fault_state(l.rig.world, 0, &s));
	assert_int_equal(s.status, BB_ERR_LOST);
	live_done(&l);
}

/* Classes whose sims are part of the fixture. */
static const char *target_of(const char *class_name)
{
	static const char *const known[][2] = { { "shutter", "chain" }, { "camera", "c1" }, { "display", "front" },
		                                { "link", "net" },      { "node", "left" }, { "world", "viewer" } };

	for (size_t i = 0; i < BB_ARRAY_LEN(known); i++)
		if (!strcmp(known[i][0], class_name))
			return known[i][1];
	return NULL;
}

static void every_verb_with_its_example_can_be_planted(void **state)
{
	const struct sim_verb *v;
	const char *class_name = NULL;
	int tried = 0;

	(void)state;
	for (size_t i = 0; (v = sim_fault_verb(i, &class_name)); i++) {
		char text[200];
		struct sim_fault_state s;
		const char *id = target_of(class_name);
		assert_true(strlen(v->meaning) > 5);
		snprintf(text, sizeof(text), "at 50ms %s/%s %s %s for 100ms", class_name, id ? id : "x", v->name,
		         v->example);
		const struct sim_fault f = parsed(text);
		if (!id)
			continue;
		struct live l;
		live_init(&l);
		assert_int_equal(sim_faults_plant(l.rig.world, &f, 1, 10 * MS, NULL), BB_OK);
		assert_int_equal(sim_faults_start(l.rig.world), BB_OK);
		rig_run(&l.rig, BB_NS_PER_S);
		assert_true(sim_fault_state(l.rig.world, 0, &s));
		if (s.status != BB_OK)
			fail_msg("%s: %s", text, bb_status_text(s.status));
		assert_int_equal(s.cleared_ns, 150 * MS);
		live_done(&l);
		tried++;
	}
	assert_true(tried >= 28);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(reads_what_people_write),
		cmocka_unit_test(refuses_the_rest_with_a_number),
		cmocka_unit_test(very_long_and_random_texts_are_refused_in_peace),
		cmocka_unit_test(a_file_has_one_a_line),
		cmocka_unit_test(broken_files_are_refused_with_their_line),
		cmocka_unit_test(faults_are_set_cleared_and_may_overlap),
		cmocka_unit_test(planting_names_what_is_wrong),
		cmocka_unit_test(a_closed_device_is_reported_not_touched),
		cmocka_unit_test(every_verb_with_its_example_can_be_planted),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
