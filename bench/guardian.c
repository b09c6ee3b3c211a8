#include "bench/guardian.h"

#include <errno.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "bench/backends.h"
#include "bench/cli.h"

static volatile sig_atomic_t caught;
static volatile sig_atomic_t child;

static const int ends[] = { SIGINT, SIGTERM, SIGHUP, SIGPIPE };

/* A terminal and systemd tell parent and child, and the parent passes it on: that is one signal, not the second one. */
static void catch(int number, siginfo_t *info, void *context)
{
	static volatile sig_atomic_t times[2][NSIG];
	const bool passed_on = info->si_code == SI_QUEUE;

	(void)context;
	caught = number;
	times[passed_on][number]++;
	if (times[passed_on][number] < 2)
		return;
	signal(number, SIG_DFL);
	raise(number);
}

static void pass_on(int number, siginfo_t *info, void *context)
{
	(void)info;
	(void)context;
	if (child > 0)
		sigqueue(child, number, (union sigval){ 0 });
}

static void handle(void (*handler)(int, siginfo_t *, void *), int flags)
{
	struct sigaction action = { .sa_flags = flags | SA_SIGINFO }, was;

	action.sa_sigaction = handler;
	for (size_t i = 0; i < BB_ARRAY_LEN(ends); i++)
		if (sigaction(ends[i], &action, &was) == 0 && ends[i] == SIGHUP && was.sa_handler == SIG_IGN)
			sigaction(SIGHUP, &was, NULL); /* nohup */
}

const volatile sig_atomic_t *bb_guardian_signals(void)
{
	handle(catch, 0); /* sleeping is broken off: no SA_RESTART */
	return &caught;
}

bool bb_guardian_wanted(const struct bb_room *room)
{
	return room->has_chain && room->chain.device[0] && strncmp(room->chain.device, "sim:", 4) != 0;
}

/* Closing a chain leaves every stage open, whatever state it was in. */
static enum bb_status open_shutters(const struct bb_room *room)
{
	struct bb_clock *clk = NULL;
	struct bb_uri uri;
	struct bb_shutter *sh = NULL;
	struct bb_error err = { 0 };
	enum bb_status status = bb_uri_parse(room->chain.device, &uri, &(struct bb_where){ 0 }, &err);
	const struct bb_backend *backend = status == BB_OK ? bb_backend_find(&uri, "shutter", &err) : NULL;

	if (!backend || !backend->shutter)
		return BB_ERR_UNSUPPORTED;
	status = bb_clock_posix_create(&clk);
	const struct bb_open open = { .clk = clk, .uri = &uri, .fidelity = 1, .seed = 1 };
	if (status == BB_OK)
		status = bb_shutter_open(backend->shutter, &room->chain, &open, &sh);
	if (status == BB_OK)
		status = bb_shutter_set_mode(sh, BB_SHUTTER_OPEN);
	bb_shutter_close(sh);
	bb_clock_destroy(clk);
	return status;
}

bool bb_guardian_fork(const struct bb_room *room, int *code_out, struct bb_error *err)
{
	const pid_t parent = getpid();
	int how = 0;
	const pid_t pid = fork();

	if (pid < 0)
		return true;
	if (pid == 0) {
		prctl(PR_SET_PDEATHSIG, SIGTERM); /* nobody is left to watch: end in good order */
		if (getppid() != parent)
			raise(SIGTERM);
		return true;
	}
	child = pid;
	handle(pass_on, SA_RESTART);
	while (waitpid(pid, &how, 0) < 0 && errno == EINTR)
		;
	if (WIFEXITED(how)) {
		*code_out = WEXITSTATUS(how);
		return false;
	}
	const bool real = bb_guardian_wanted(room);
	const enum bb_status status = real ? open_shutters(room) : BB_OK;
	*code_out = BB_EXIT_INTERNAL;
	(void)!bb_fail(err, BB_ERR_LOST, 1692, NULL, "of signal %d (%s); shutters %s", WTERMSIG(how), strsignal(WTERMSIG(how)),
	               status != BB_OK ? bb_status_text(status) : real ? "opened" : "died with it: they are simulated");
	return false;
}
