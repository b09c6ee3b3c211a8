/*
 * tests/lint_stubs.h: for clang-tidy only, put before every source by tests/lint.sh. bb_fail and bb_device_fail return
 * the status they are given; the analyser looks at one file at a time and cannot know, and then follows paths on which
 * a failure was reported and BB_OK returned.
 */
#include "hal/status.h"

#include "hal/device.h"

#define bb_fail(err, status, ...) (bb_fail((err), (status), __VA_ARGS__), (status))
#define bb_device_fail(dev, status, ...) (bb_device_fail((dev), (status), __VA_ARGS__), (status))
