/*
 * tests/test_hostile_config.c: every broken file under tests/hostile/{rooms,scenes,paths} is refused with the number
 * that its name begins with, names file and line, leaves no result behind and is quick. More of the kind are made here:
 * cut short, with a byte changed, too large, no file at all.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <cmocka.h>

#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "hal/profile.h"
#include "hal/room.h"
#include "hal/scene.h"

enum kind { ROOM, SCENE, PATH };

/* Loads and frees; asserts that failure leaves nothing behind. */
static enum bb_status load(enum kind kind, const char *path, struct bb_error *err)
{
	struct bb_path *head = (struct bb_path *)1;
	struct bb_scene *scene = (struct bb_scene *)1;
	struct bb_room *room = (struct bb_room *)1;
	enum bb_status status;

	memset(err, 0, sizeof(*err));
	if (kind == ROOM) {
		status = bb_room_load(path, &room, err);
		assert_true((status == BB_OK) == (room != NULL));
		bb_room_free(room);
	} else if (kind == SCENE) {
		status = bb_scene_load(path, &scene, err);
		assert_true((status == BB_OK) == (scene != NULL));
		bb_scene_free(scene);
	} else {
		status = bb_path_load(path, &head, err);
		assert_true((status == BB_OK) == (head != NULL));
		bb_path_free(head);
	}
	assert_true((status == BB_OK) == (err->number == 0));
	return status;
}

static double now_s(void)
{
	struct timespec ts;

	clock_gettime(CLOCK_MONOTONIC, &ts);
	return (double)ts.tv_sec + 1e-9 * (double)ts.tv_nsec;
}

static void check_one(enum kind kind, const char *folder, const char *name)
{
	const int wanted = atoi(name);
	const double start_s = now_s();
	char path[600], place[700], number[16];
	struct bb_error err;
	enum bb_status status;

	snprintf(path, sizeof(path), "%s/%s", folder, name);
	status = load(kind, path, &err);
	if (err.number != wanted)
		fail_msg("%s: wanted %d, got '%s'", path, wanted, err.text);
	assert_true(status == BB_ERR_CONFIG || status == BB_ERR_FORMAT || status == BB_ERR_REFUSED);
	snprintf(place, sizeof(place), "%s:", path); /* file:line:column */
	snprintf(number, sizeof(number), "BB%04d: ", wanted);
	const char *at = strstr(err.text, place);
	if (strncmp(err.text, number, strlen(number)) || !at || atoi(at + strlen(place)) < 1)
		fail_msg("no number, file or line in '%s'", err.text);
	if (!strstr(err.text, "; likely cause: ") || !strstr(err.text, "; next: ") || strstr(err.text, "a bug in blackburst"))
		fail_msg("number %d has no entry in hal/errors.def", wanted);
	assert_true(now_s() - start_s < 1);
}

static size_t check_folder(enum kind kind, const char *folder)
{
	DIR *dir = opendir(folder);
	struct dirent *entry;
	size_t n = 0;

	assert_non_null(dir);
	while ((entry = readdir(dir)))
		if (entry->d_name[0] != '.') {
			check_one(kind, folder, entry->d_name);
			n++;
		}
	closedir(dir);
	return n;
}

static void every_broken_file_is_refused(void **state)
{
	const size_t rooms = check_folder(ROOM, "tests/hostile/rooms"), scenes = check_folder(SCENE, "tests/hostile/scenes");
	const size_t paths = check_folder(PATH, "tests/hostile/paths");

	(void)state;
	print_message("%zu rooms, %zu scenes, %zu paths\n", rooms, scenes, paths);
	assert_true(rooms >= 30 && scenes >= 10 && paths >= 5);
}

static void what_is_no_file_is_refused(void **state)
{
	char fifo[] = "/tmp/bb-fifo-XXXXXX";
	struct bb_error err;

	(void)state;
	load(ROOM, "rooms/no-such-room.yaml", &err);
	assert_int_equal(err.number, 1001);
	load(ROOM, "rooms", &err);
	assert_int_equal(err.number, 1018);
	load(SCENE, "/dev/zero", &err);
	assert_int_equal(err.number, 1018);
	assert_non_null(mkdtemp(fifo));
	assert_int_equal(rmdir(fifo), 0);
	assert_int_equal(mkfifo(fifo, 0600), 0);
	load(PATH, fifo, &err); /* must not wait for a writer */
	assert_int_equal(err.number, 1018);
	unlink(fifo);
}

static void write_file(const char *path, const char *bytes, size_t n)
{
	FILE *f = fopen(path, "wb");

	assert_non_null(f);
	assert_int_equal(fwrite(bytes, 1, n, f), n);
	fclose(f);
}

static void large_files_are_refused(void **state)
{
	const size_t n = (1u << 20) + 1;
	char name[] = "/tmp/bb-large-XXXXXX", *bytes = malloc(n);
	struct bb_error err;
	const int fd = mkstemp(name);

	(void)state;
	assert_non_null(bytes);
	close(fd);
	memset(bytes, '#', n);
	write_file(name, bytes, n);
	load(ROOM, name, &err);
	assert_int_equal(err.number, 1003);
	load(PATH, name, &err);
	assert_int_equal(err.number, 1003);
	write_file(name, bytes, n - 1); /* exactly 1 MiB of comment: read, and nothing in it */
	load(ROOM, name, &err);
	assert_int_equal(err.number, 1004);
	free(bytes);
	unlink(name);
}

static char *read_file(const char *path, size_t *n)
{
	FILE *f = fopen(path, "rb");
	char *bytes = malloc(1 << 16);

	assert_non_null(f);
	assert_non_null(bytes);
	*n = fread(bytes, 1, 1 << 16, f);
	fclose(f);
	return bytes;
}

static void repeat(const char *path, const char *head, const char *line, int times)
{
	FILE *f = fopen(path, "wb");

	assert_non_null(f);
	fputs(head, f);
	for (int i = 0; i < times; i++)
		fprintf(f, line, i);
	fclose(f);
}

static void endless_lists_are_refused(void **state)
{
	char name[] = "/tmp/bb-many-XXXXXX";
	struct bb_error err;

	(void)state;
	close(mkstemp(name));
	repeat(name, "room: x\nnodes:\n", "- %d\n", 100000);
	load(ROOM, name, &err);
	assert_int_equal(err.number, 1016);
	repeat(name, "", "%d 0 1 0 0 0 0\n", 10400);
	load(PATH, name, &err);
	assert_int_equal(err.number, 1352);
	unlink(name);
}

/* Good files cut short and with bytes changed, from a fixed sequence: refused with a number or loaded, never worse. */
static void damage(enum kind kind, const char *path, int rounds)
{
	char name[] = "/tmp/bb-damage-XXXXXX", *bytes, *copy;
	uint64_t x = UINT64_C(0x9E3779B97F4A7C15);
	struct bb_error err;
	int refused = 0;
	size_t n;

	close(mkstemp(name));
	bytes = read_file(path, &n);
	copy = malloc(n);
	assert_non_null(copy);
	for (int i = 0; i < rounds; i++) {
		x ^= x << 13, x ^= x >> 7, x ^= x << 17;
		size_t m = i & 1 ? n : (size_t)(x >> 20) % n;
		memcpy(copy, bytes, n);
		for (int k = 0; k < 1 + (i & 3); k++)
			copy[(size_t)(x >> (8 + 9 * k)) % n] = "{}[]:,-#&*!|>'\"%@`0e9.\n\t \x01~"[(x >> (3 * k)) % 27];
		write_file(name, copy, m);
		refused += load(kind, name, &err) != BB_OK;
	}
	print_message("%s: %d of %d damaged copies refused\n", path, refused, rounds);
	assert_true(refused > rounds / 4);
	free(bytes);
	free(copy);
	unlink(name);
}

static void damaged_files_never_crash(void **state)
{
	(void)state;
	damage(ROOM, "rooms/cabin.yaml", 400);
	damage(ROOM, "rooms/deck.yaml", 200);
	damage(SCENE, "scenes/epi.yaml", 400);
	damage(PATH, "scenes/seated.path", 400);
}

static void profiles_are_checked(void **state)
{
	char name[] = "/tmp/bb-profile-XXXXXX";
	struct bb_profile p;
	struct bb_error err = { 0 };

	(void)state;
	close(mkstemp(name));
	write_file(name, "profile: x\nframe_base_ns: -1\n", 29);
	assert_int_equal(bb_profile_load(name, &p, &err), BB_ERR_CONFIG);
	assert_int_equal(err.number, 1013);
	err.number = 0;
	write_file(name, "profile: x\n", 11);
	assert_int_equal(bb_profile_load(name, &p, &err), BB_ERR_CONFIG);
	assert_int_equal(err.number, 1017);
	err.number = 0;
	assert_int_equal(bb_profile_load_for("rooms/cabin.yaml", "no-such", &p, &err), BB_ERR_CONFIG);
	assert_int_equal(err.number, 1001);
	unlink(name);
}

static void memory_stays_small(void **state)
{
	struct rusage usage;

	(void)state;
#ifdef __SANITIZE_ADDRESS__
	print_message("skipped: a sanitizer's own memory would be counted\n");
	skip();
#endif
	getrusage(RUSAGE_SELF, &usage);
	print_message("peak resident set %ld KiB\n", usage.ru_maxrss);
	assert_true(usage.ru_maxrss < 256 * 1024);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(every_broken_file_is_refused), cmocka_unit_test(what_is_no_file_is_refused),
		cmocka_unit_test(large_files_are_refused),      cmocka_unit_test(endless_lists_are_refused),
		cmocka_unit_test(damaged_files_never_crash),
		cmocka_unit_test(profiles_are_checked),         cmocka_unit_test(memory_stays_small),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
