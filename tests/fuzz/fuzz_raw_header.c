/*
 * tests/fuzz/fuzz_raw_header.c: any bytes as the text header of a raw volume, in a file in memory. The voxels it names
 * are never there: what reads them is what fuzz_nifti.c reaches.
 */
#define _GNU_SOURCE /* memfd_create */
#include <stdio.h>
#include <sys/mman.h>
#include <unistd.h>

#include "render/volume/volume_private.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	static char path[64];
	static int fd = -1; /* made once */
	struct bb_volume *v = NULL;
	struct bb_error err = { 0 };

	if (fd < 0) {
		fd = memfd_create("fuzz", MFD_CLOEXEC);
		snprintf(path, sizeof(path), "/proc/self/fd/%d", fd);
	}
	fuzz_must(fd >= 0 && ftruncate(fd, 0) == 0 && pwrite(fd, data, size, 0) == (ssize_t)size);
	fuzz_must(bb_volume_load_raw(path, 1u << 20, &v, &err) != BB_OK && !v && err.number >= 1000);
	return 0;
}
