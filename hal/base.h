/*
 * hal/base.h: the few words every other header needs: fixed sizes, the marks for the compiler, container_of.
 * No state, no threads.
 */
#ifndef BB_HAL_BASE_H
#define BB_HAL_BASE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define BB_ID_MAX 32   /* bytes of an id with its NUL: nodes, walls, devices */
#define BB_PATH_MAX_BYTES 1024

#define BB_MUST_CHECK __attribute__((warn_unused_result))
#define BB_PRINTF(fmt, args) __attribute__((format(printf, fmt, args)))
#define BB_ARRAY_LEN(a) (sizeof(a) / sizeof((a)[0]))
#define bb_container_of(ptr, type, member) ((type *)(void *)((char *)(ptr) - offsetof(type, member)))

#endif
