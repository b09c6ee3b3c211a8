/*
 * tests/fuzz/replay.c: runs a fuzz target over its corpus once, without a fuzzer: every golden frame and every find is
 * an ordinary test. Arguments: files or folders. Exit 0; a crash is the failure.
 */
#include <dirent.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/stat.h>

#define MOST_BYTES (1 << 20)

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static int replay_file(const char *path)
{
	FILE *in = fopen(path, "rb");
	uint8_t *bytes = in ? malloc(MOST_BYTES) : NULL;

	if (!bytes) {
		if (in)
			fclose(in);
		return -1;
	}
	const size_t n = fread(bytes, 1, MOST_BYTES, in);
	fclose(in);
	uint8_t *exact = malloc(n ? n : 1); /* no slack behind the input: an overrun is seen */
	for (size_t i = 0; exact && i < n; i++)
		exact[i] = bytes[i];
	free(bytes);
	if (exact)
		LLVMFuzzerTestOneInput(exact, n);
	free(exact);
	return 0;
}

int main(int argc, char **argv)
{
	unsigned n = 0;

	for (int i = 1; i < argc; i++) {
		DIR *dir = opendir(argv[i]);
		for (struct dirent *e; dir && (e = readdir(dir));) {
			char path[4096];
			snprintf(path, sizeof(path), "%s/%s", argv[i], e->d_name);
			n += e->d_name[0] != '.' && !replay_file(path);
		}
		if (dir)
			closedir(dir);
		else
			n += !replay_file(argv[i]);
	}
	printf("%u inputs\n", n);
	return n ? 0 : 1;
}
