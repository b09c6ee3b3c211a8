/*
 * tests/hw_room.c: the contracts of the device classes against the devices a room file names, whatever they are: a real
 * room, or `serve` on loopback as a stand-in. Sims are skipped, and so is every class without a real device, each with
 * the reason. Writes a record of what was found and how it went. Real time.
 *
 * Usage: hw_room ROOM --out FILE --date TEXT [--switch PDU/OUTLET]... [--switch MONITOR]... [--standin]
 * Nothing is switched, and no monitor's setting changed, unless it is named. --standin shortens the safety times 600
 * times and leaves eyes no rest; it is refused for a power strip or a chain that is neither on loopback nor on a pty nor
 * on a virtual CAN: behind those are no lamps.
 */
#include "tests/power_contract.h"

#include <jansson.h>
#include <stdio.h>
#include <sys/utsname.h>

#include "bench/backends.h"
#include "bench/file.h"
#include "hal/room.h"

#define SWITCHES_MAX 16
#define ROWS_MAX 256
#define SCHEMA "blackburst-hw-record-1"

struct hw {
	const char *room_path, *out_path, *date;
	size_t n_switches;
	const char *switches[SWITCHES_MAX];
	bool standin;
	struct bb_room *room;
	struct bb_clock *clk;
	size_t n_rows;
	struct row {
		struct hw *hw;
		const char *class_name, *id, *device, *what;
		char name[96], reason[160], found[160];
		struct bb_power_config power;
		void (*check)(struct power_bench *);
		void (*run)(struct row *row); /* NULL: skipped, for the reason */
		const void *config;           /* its class's */
		size_t step;                  /* of its class's checks */
		const char *result;
	} row[ROWS_MAX];
};

/* ---- power ---- */

static bool harmless(const char *device)
{
	return !strncmp(device, "modbus:tcp://127.", 17) || !strncmp(device, "modbus:rtu:/dev/pts/", 20);
}

static enum bb_status open_power(struct row *row, struct power_bench *t)
{
	struct bb_uri uri;
	struct bb_error err = { 0 };
	enum bb_status status = bb_uri_parse(row->device, &uri, NULL, &err);
	const struct bb_backend *b = status == BB_OK ? bb_backend_find(&uri, row->id, &err) : NULL;
	const struct bb_open open = { .clk = row->hw->clk, .uri = &uri, .seed = 1 };

	if (!b || !b->power) {
		snprintf(row->reason, sizeof(row->reason), "%.150s", b ? "its back end has no power strips" : err.text);
		return BB_ERR_CONFIG;
	}
	status = bb_power_open(b->power, &row->power, &open, &t->p);
	if (status != BB_OK)
		snprintf(row->reason, sizeof(row->reason), "cannot be opened: %s", bb_status_text(status));
	return status;
}

/* Every outlet answers, and together they stay below the fuse. */
static void outlets_are_known(struct power_bench *t)
{
	struct row *row = t->impl;
	double total_a = 0;
	size_t on = 0;

	for (size_t i = 0; i < t->config->n_outlets; i++) {
		struct bb_outlet_state s;
		assert_int_equal(bb_power_read(t->p, i, &s), BB_OK);
		if (!s.known)
			fail_msg("outlet %d: %s", (int)t->config->outlet[i].outlet,
			         bb_power_device(t->p)->last_error.detail);
		assert_true(s.current_a >= 0);
		assert_in_range(bb_clock_now_ns(t->clk) - s.at_ns, 0, t->age_ns);
		total_a += s.current_a;
		on += s.closed;
	}
	assert_true(total_a <= bb_power_limits(t->p)->most_total_a);
	snprintf(row->found, sizeof(row->found), "%zu of %zu outlets on, %.2f A", on, t->config->n_outlets, total_a);
}

static void run_power(struct row *row)
{
	struct power_bench t = { .clk = row->hw->clk, .config = &row->power, .early = 0.5, .impl = row };

	for (size_t i = 0; i < row->hw->n_switches; i++) {
		char name[2 * BB_ID_MAX];
		for (size_t o = 0; o < row->power.n_outlets; o++) {
			snprintf(name, sizeof(name), "%s/%d", row->id, (int)row->power.outlet[o].outlet);
			if (!strcmp(name, row->hw->switches[i]))
				t.index = o;
		}
	}
	if (open_power(row, &t) != BB_OK)
		fail_msg("%s", row->reason);
	t.age_ns = bb_power_limits(t.p)->settle_ns;
	row->check(&t);
	bb_power_close(t.p);
}

static struct row *add_row(struct hw *hw, const char *class_name, const char *id, const char *device, const char *what)
{
	if (hw->n_rows == ROWS_MAX)
		return NULL;
	struct row *row = &hw->row[hw->n_rows++];
	*row = (struct row){ .hw = hw, .class_name = class_name, .id = id, .device = device, .what = what, .result = "fail" };
	snprintf(row->name, sizeof(row->name), "%s%s%s%s%s", class_name, id[0] ? "/" : "", id, what[0] ? ": " : "", what);
	return row;
}

static bool may_switch(const struct hw *hw, const char *id)
{
	for (size_t i = 0; i < hw->n_switches; i++)
		if (!strncmp(hw->switches[i], id, strlen(id)) && hw->switches[i][strlen(id)] == '/')
			return true;
	return false;
}

static void add_power(struct hw *hw, const struct bb_power_config *config)
{
	static const struct {
		const char *what;
		void (*check)(struct power_bench *);
		bool switches;
	} checks[] = {
		{ "every outlet is known", outlets_are_known, false },
		{ "bad calls are refused", power_bad_calls_are_refused, false },
		{ "switching is read back", power_switching_is_read_back, true },
		{ "safety times are kept", power_times_are_kept, true },
	};

	for (size_t i = 0; i < BB_ARRAY_LEN(checks); i++) {
		struct row *row = add_row(hw, "power", config->id, config->device, checks[i].what);
		if (!row)
			return;
		row->power = *config;
		row->check = checks[i].check;
		row->run = run_power;
		if (hw->standin && harmless(config->device)) {
			row->power.safety.outlet_least_off_s /= 600;
			row->power.safety.outlet_least_on_s /= 600;
			row->power.safety.outlet_stagger_ms /= 600;
		}
		if (checks[i].switches && !may_switch(hw, config->id)) {
			row->run = NULL;
			snprintf(row->reason, sizeof(row->reason), "no outlet of it may be switched: SWITCH=%s/N allows one", config->id);
		}
	}
}

/* ---- all classes ---- */

static bool simulated(const char *device)
{
	return !device[0] || !strncmp(device, "sim:", 4);
}

#include "tests/hw_camera.h"
#include "tests/hw_gamepad.h"
#include "tests/hw_monitor.h"
#include "tests/hw_shutter.h"

static void check_row(void **state)
{
	struct row *row = *state;

	if (!row->run) {
		print_message("SKIP: %s: %s\n", row->name, row->reason);
		row->result = "skip";
		skip();
	}
	row->run(row);
	row->result = "pass";
}

/* A class without a contract for real devices here, or without a real device. */
static void skip_class(struct hw *hw, const char *class_name, size_t n, size_t n_real)
{
	struct row *row = add_row(hw, class_name, "", "", "");

	if (!row)
		return;
	if (n_real)
		snprintf(row->reason, sizeof(row->reason), "%zu real devices, but no contract for them yet", n_real);
	else if (n)
		snprintf(row->reason, sizeof(row->reason), "all %zu of this room are simulated", n);
	else
		snprintf(row->reason, sizeof(row->reason), "this room has none");
}

#define COUNT_REAL(list, n, n_real)                                                                                  \
	do {                                                                                                         \
		(n_real) = 0;                                                                                        \
		for (size_t i_ = 0; i_ < (n); i_++)                                                                  \
			(n_real) += !simulated((list)[i_].device);                                                   \
	} while (0)

static void collect(struct hw *hw)
{
	const struct bb_room *r = hw->room;
	size_t n_real;

	if (!add_shutters(hw))
		skip_class(hw, "shutter", r->has_chain, 0);
	if (!add_cameras(hw))
		skip_class(hw, "camera", r->n_cameras, 0);
	COUNT_REAL(&r->screens[0].display, r->n_screens ? 1 : 0, n_real);
	skip_class(hw, "display", r->n_screens, n_real);
	if (!add_monitors(hw))
		skip_class(hw, "monitor", r->n_monitors, 0);
	COUNT_REAL(r->pdus, r->n_pdus, n_real);
	if (!n_real)
		skip_class(hw, "power", r->n_pdus, 0);
	for (size_t i = 0; i < r->n_pdus; i++)
		if (!simulated(r->pdus[i].device))
			add_power(hw, &r->pdus[i]);
	if (!add_gamepads(hw))
		skip_class(hw, "gamepad", r->n_gamepads, 0);
	skip_class(hw, "link", 1, !simulated(r->link.device));
}

static int write_record(const struct hw *hw)
{
	struct utsname u;
	struct bb_file f;
	struct bb_error err = { 0 };
	json_t *root = json_object(), *rows = json_array();

	json_object_set_new(root, "schema", json_string(SCHEMA));
	json_object_set_new(root, "date", json_string(hw->date));
	json_object_set_new(root, "room", json_string(hw->room->name));
	json_object_set_new(root, "room_file", json_string(hw->room_path));
	json_object_set_new(root, "standin", json_boolean(hw->standin));
	if (uname(&u) == 0)
		json_object_set_new(root, "machine", json_pack("{s:s, s:s, s:s}", "system", u.sysname, "release", u.release,
		                                               "architecture", u.machine));
	for (size_t i = 0; i < hw->n_rows; i++)
		json_array_append_new(rows, json_pack("{s:s, s:s, s:s, s:s, s:s, s:s, s:s}", "class", hw->row[i].class_name,
		                                      "id", hw->row[i].id, "device", hw->row[i].device, "check",
		                                      hw->row[i].what, "result", hw->row[i].result, "reason",
		                                      hw->row[i].reason, "found", hw->row[i].found));
	json_object_set_new(root, "rows", rows);
	char *text = json_dumps(root, JSON_INDENT(2));
	json_decref(root);
	enum bb_status status = text ? bb_file_begin(&f, hw->out_path, &err) : BB_ERR_NOMEM;
	if (status == BB_OK) {
		fprintf(f.out, "%s\n", text);
		status = bb_file_commit(&f, &err);
	}
	free(text);
	if (status != BB_OK)
		fprintf(stderr, "%s\n", err.text);
	return status == BB_OK ? 0 : 2;
}

static bool read_arguments(struct hw *hw, int argc, char **argv)
{
	for (int i = 1; i < argc; i++) {
		const char *value = i + 1 < argc ? argv[i + 1] : NULL;
		if (!strcmp(argv[i], "--standin")) {
			hw->standin = true;
			continue;
		}
		if (argv[i][0] != '-' && !hw->room_path) {
			hw->room_path = argv[i];
			continue;
		}
		if (!value)
			return false;
		if (!strcmp(argv[i], "--out"))
			hw->out_path = value;
		else if (!strcmp(argv[i], "--date"))
			hw->date = value;
		else if (!strcmp(argv[i], "--switch") && hw->n_switches < SWITCHES_MAX)
			hw->switches[hw->n_switches++] = value;
		else
			return false;
		i++;
	}
	return hw->room_path && hw->out_path && hw->date;
}

static bool standin_is_one(const struct hw *hw)
{
	const struct bb_room *r = hw->room;

	if (hw->standin && r->has_chain && !simulated(r->chain.device) && !hw_shutter_harmless(r->chain.device)) {
		fprintf(stderr, "hw_room: --standin, but the chain is %s\n", r->chain.device);
		return false;
	}
	for (size_t i = 0; hw->standin && i < hw->room->n_pdus; i++)
		if (!simulated(hw->room->pdus[i].device) && !harmless(hw->room->pdus[i].device)) {
			fprintf(stderr, "hw_room: --standin, but %s is %s\n", hw->room->pdus[i].id, hw->room->pdus[i].device);
			return false;
		}
	return true;
}

int main(int argc, char **argv)
{
	struct hw *hw = calloc(1, sizeof(*hw));
	struct CMUnitTest *tests = calloc(ROWS_MAX, sizeof(*tests));
	struct bb_error err = { 0 };
	int code = 2;

	if (!hw || !tests || !read_arguments(hw, argc, argv)) {
		fprintf(stderr, "usage: hw_room ROOM --out FILE --date TEXT [--switch PDU/OUTLET]... [--standin]\n");
	} else if (bb_room_load(hw->room_path, &hw->room, &err) != BB_OK) {
		fprintf(stderr, "%s\n", err.text);
	} else if (standin_is_one(hw) && bb_clock_posix_create(&hw->clk) == BB_OK) {
		collect(hw);
		for (size_t i = 0; i < hw->n_rows; i++)
			tests[i] = (struct CMUnitTest){ hw->row[i].name, check_row, NULL, NULL, &hw->row[i] };
		const int failed = _cmocka_run_group_tests("room", tests, hw->n_rows, NULL, NULL);
		code = write_record(hw);
		code = code ? code : failed != 0;
		bb_clock_destroy(hw->clk);
	}
	if (hw)
		bb_room_free(hw->room);
	free(tests);
	free(hw);
	return code;
}
