#include "sim/verb_args.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

static bool listed(const char *known, const char *key)
{
	const size_t n = strlen(key);

	for (const char *at = known; n && (at = strstr(at, key)); at += n)
		if ((at == known || at[-1] == ' ') && (at[n] == ' ' || !at[n]))
			return true;
	return false;
}

enum bb_status sim_args_only(const struct sim_fault_args *args, const char *known, struct bb_error *err)
{
	for (size_t i = 0; i < args->n && i < SIM_FAULT_ARGS_MAX; i++)
		if (!listed(known, args->arg[i].key))
			return bb_fail(err, BB_ERR_CONFIG, 1605, NULL, "'%s' is no argument here (known: %s)",
			               args->arg[i].key, *known ? known : "none");
	return BB_OK;
}

enum bb_status sim_args_need(const struct sim_fault_args *args, const char *key, struct bb_error *err)
{
	if (sim_fault_arg(args, key))
		return BB_OK;
	return bb_fail(err, BB_ERR_CONFIG, 1605, NULL, "'%s=' is missing", key);
}

enum bb_status sim_args_whole(const struct sim_fault_args *args, const char *key, long fallback, long least,
                              long most, long *out, struct bb_error *err)
{
	const char *text = sim_fault_arg(args, key);
	char *end;

	*out = fallback;
	if (!text)
		return BB_OK;
	/* Base 10 unless it says 0x: a leading zero must not turn 010 into 8. */
	const bool hex = text[0] == '0' && (text[1] == 'x' || text[1] == 'X');
	errno = 0;
	const long value = strtol(text, &end, hex ? 16 : 10);
	if (errno || end == text || *end || value < least || value > most)
		return bb_fail(err, BB_ERR_CONFIG, 1605, NULL, "%s=%s: want a whole number from %ld to %ld", key, text,
		               least, most);
	*out = value;
	return BB_OK;
}

enum bb_status sim_args_real(const struct sim_fault_args *args, const char *key, double fallback, double least,
                             double most, double *out, struct bb_error *err)
{
	double value;

	*out = fallback;
	if (!sim_fault_number(args, key, fallback, &value) || !(value >= least && value <= most))
		return bb_fail(err, BB_ERR_CONFIG, 1605, NULL, "%s=%s: want a number from %g to %g", key,
		               sim_fault_arg(args, key), least, most);
	*out = value;
	return BB_OK;
}
