/* bench/cmd/doctor.c: `blackburst doctor`: what this machine has and what a room on it would miss. Opens no device. */
#include <dlfcn.h>
#include <jansson.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/utsname.h>
#include <unistd.h>

#include "bench/cli.h"
#include "render/renderer.h"

#define ADDRESS_FAMILY_CAN 29

static const struct bb_cli_option options[] = {
	{ "json", NULL, "machine-readable" },
	{ NULL, NULL, NULL },
};

struct check {
	const char *name, *remedy;
	bool needed;          /* a missing one fails the check */
	bool (*there)(char *note, size_t cap);
};

static bool library(const char *name, char *note, size_t cap)
{
	void *handle = dlopen(name, RTLD_LAZY | RTLD_LOCAL);

	snprintf(note, cap, "%s", handle ? name : dlerror());
	if (handle)
		dlclose(handle);
	return handle != NULL;
}

static bool osmesa(char *note, size_t cap)
{
	return library("libOSMesa.so.8", note, cap);
}

static bool egl(char *note, size_t cap)
{
	return library("libEGL.so.1", note, cap);
}

static bool draws(char *note, size_t cap)
{
	struct bb_error err = { 0 };
	struct bb_renderer *r = NULL;
	const bool ok = bb_renderer_gl_create("auto", &r, &err) == BB_OK;

	snprintf(note, cap, "%s", ok ? bb_renderer_description(r) : err.text);
	bb_renderer_destroy(r);
	return ok;
}

static bool can(char *note, size_t cap)
{
	const int fd = socket(ADDRESS_FAMILY_CAN, SOCK_RAW, 1);

	snprintf(note, cap, fd >= 0 ? "AF_CAN sockets work" : "this kernel has no AF_CAN");
	if (fd >= 0)
		close(fd);
	return fd >= 0;
}

static bool node(const char *path, char *note, size_t cap)
{
	const bool there = access(path, F_OK) == 0, mine = access(path, R_OK | W_OK) == 0;

	snprintf(note, cap, "%s %s", path, mine ? "may be used" : there ? "may not be used" : "is not there");
	return mine;
}

static bool gpio(char *note, size_t cap)
{
	return node("/dev/gpiochip0", note, cap);
}

static bool i2c(char *note, size_t cap)
{
	return node("/dev/i2c-0", note, cap);
}

static bool data(char *note, size_t cap)
{
	const bool there = access("build/data/example4d.nii.gz", R_OK) == 0;

	snprintf(note, cap, "build/data/example4d.nii.gz %s", there ? "is there" : "is missing");
	return there;
}

static const struct check checks[] = {
	{ "osmesa", "apt-get install libosmesa6", false, osmesa },
	{ "egl", "apt-get install libegl1 libegl-mesa0", false, egl },
	{ "draws", "install one of the two above", true, draws },
	{ "data", "make data", false, data },
	{ "can", "load the can modules; sims need none", false, can },
	{ "gpio", "a GPIO chip, or a udev rule for it; sims need none", false, gpio },
	{ "i2c", "modprobe i2c-dev, join group i2c; sims need none", false, i2c },
};

static int command(const struct bb_cli *cli)
{
	json_t *rows = bb_cli_has(cli, "json") ? json_array() : NULL;
	int code = BB_EXIT_OK;

	for (size_t i = 0; i < BB_ARRAY_LEN(checks); i++) {
		const struct check *c = &checks[i];
		char note[700] = "";
		const bool ok = c->there(note, sizeof(note));
		if (!ok && c->needed)
			code = BB_EXIT_FAILED;
		if (rows)
			json_array_append_new(rows, json_pack("{s:s, s:b, s:b, s:s, s:s}", "check", c->name, "ok", ok,
			                                      "needed", c->needed, "note", note, "remedy",
			                                      ok ? "" : c->remedy));
		else
			printf("%-7s %-8s %s%s%s\n", ok ? "ok" : c->needed ? "MISSING" : "absent", c->name, note,
			       ok ? "" : "; next: ", ok ? "" : c->remedy);
	}
	if (rows && bb_cli_print_json(rows) != BB_EXIT_OK)
		return BB_EXIT_INTERNAL;
	return code;
}

const struct bb_command bb_cmd_doctor = {
	"doctor", "what this machine has and what a room on it would miss", "[--json]", options, 0, 0, command,
};
