#define _GNU_SOURCE
#include "bench/nodes/spawn.h"

#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#define DIGITS_LEAST 32

/* In the child: only calls that are safe between fork and exec. */
static void become(int parent, int input, const char *const *argv)
{
	const int nowhere = open("/dev/null", O_WRONLY);

	if (prctl(PR_SET_PDEATHSIG, SIGKILL) || getppid() != parent) /* it may have died before we said so */
		_exit(127);
	if (nowhere < 0 || dup2(input, 0) < 0 || dup2(nowhere, 1) < 0)
		_exit(127);
	signal(SIGINT, SIG_IGN); /* the terminal's goes to the head, which ends all */
	execv("/proc/self/exe", (char *const *)(uintptr_t)argv);
	_exit(127);
}

bool bb_child_start(struct bb_child *child, const char *const *argv, const char *secret)
{
	const int parent = getpid();
	int pipe_fd[2];

	child->pid = 0;
	if (pipe2(pipe_fd, O_CLOEXEC))
		return false;
	const int pid = fork();
	if (!pid)
		become(parent, pipe_fd[0], argv);
	const bool told = pid > 0 && write(pipe_fd[1], secret, strlen(secret)) == (ssize_t)strlen(secret);
	close(pipe_fd[0]);
	close(pipe_fd[1]);
	child->pid = pid > 0 ? pid : 0;
	return told;
}

bool bb_child_ended(struct bb_child *child, char *how, size_t cap)
{
	int status;

	if (child->pid <= 0 || waitpid(child->pid, &status, WNOHANG) != child->pid)
		return false;
	child->last_pid = child->pid;
	child->pid = 0;
	if (WIFSIGNALED(status))
		snprintf(how, cap, "was killed by signal %d", WTERMSIG(status));
	else
		snprintf(how, cap, "ended with code %d", WEXITSTATUS(status));
	return true;
}

void bb_child_end(struct bb_child *child, struct bb_clock *clk, int64_t end_stopwatch_ns)
{
	char how[80];

	while (child->pid > 0 && !bb_child_ended(child, how, sizeof(how)) && bb_clock_stopwatch_ns() < end_stopwatch_ns)
		bb_clock_run_until(clk, bb_clock_now_ns(clk) + BB_NS_PER_S / 200);
	if (child->pid <= 0)
		return;
	kill(child->pid, SIGKILL);
	waitpid(child->pid, NULL, 0);
	child->pid = 0;
}

static int open_secret(const char *path)
{
	struct stat st;

	if (!strcmp(path, "-"))
		return fcntl(0, F_DUPFD_CLOEXEC, 3);
	const int fd = open(path, O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
	if (fd < 0)
		return -1;
	if (fstat(fd, &st) == 0 && S_ISREG(st.st_mode) && !(st.st_mode & 0177) && st.st_uid == geteuid())
		return fd;
	close(fd);
	errno = EACCES;
	return -1;
}

enum bb_status bb_token_read(const char *path, char token[BB_TOKEN_MAX], struct bb_error *err)
{
	const int fd = open_secret(path);
	ssize_t n = -1;
	size_t has = 0;

	if (fd < 0)
		return bb_fail(err, BB_ERR_USAGE, 1671, NULL, "%.200s: %s", path, strerror(errno));
	while (has < BB_TOKEN_MAX - 1 && (n = read(fd, token + has, BB_TOKEN_MAX - 1 - has)) > 0)
		has += (size_t)n;
	close(fd);
	token[has] = '\0';
	token[strcspn(token, "\r\n")] = '\0';
	if (n < 0 || strlen(token) < DIGITS_LEAST || strspn(token, "0123456789abcdefABCDEF") != strlen(token))
		return bb_fail(err, BB_ERR_USAGE, 1671, NULL, "%.200s has no line of %d hexadecimal digits or more", path,
		               DIGITS_LEAST);
	return BB_OK;
}
