/*
 * tests/heap.h: counts what a program takes from the heap, by standing in front of glibc's allocator; included once in
 * a program. Under a sanitizer, which does the same, nothing is counted and HEAP_COUNTED is 0.
 */
#ifndef BB_TESTS_HEAP_H
#define BB_TESTS_HEAP_H

#include <malloc.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#if defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define HEAP_COUNTED 0
#endif
#endif
#if !defined(HEAP_COUNTED) && (defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__))
#define HEAP_COUNTED 0
#endif
#ifndef HEAP_COUNTED
#define HEAP_COUNTED 1
#endif

static atomic_uint_fast64_t heap_calls, heap_asked, heap_now, heap_peak;

/* From here on; what is held now is the level that heap_rise counts from. */
static inline uint64_t heap_begin(void)
{
	atomic_store(&heap_calls, 0);
	atomic_store(&heap_asked, 0);
	atomic_store(&heap_peak, atomic_load(&heap_now));
	return atomic_load(&heap_now);
}

/* The most that was held at once since heap_begin, above what was held then. */
static inline uint64_t heap_rise(uint64_t begun)
{
	return atomic_load(&heap_peak) - begun;
}

#if HEAP_COUNTED
void *__libc_malloc(size_t n);
void *__libc_calloc(size_t n, size_t size);
void *__libc_realloc(void *p, size_t n);
void *__libc_memalign(size_t align, size_t n);
void __libc_free(void *p);

static inline void *heap_took(void *p, size_t asked)
{
	atomic_fetch_add(&heap_calls, 1);
	atomic_fetch_add(&heap_asked, asked);
	if (!p)
		return p;
	const uint64_t now = atomic_fetch_add(&heap_now, malloc_usable_size(p)) + malloc_usable_size(p);
	uint_fast64_t peak = atomic_load(&heap_peak);
	while (now > peak && !atomic_compare_exchange_weak(&heap_peak, &peak, now))
		;
	return p;
}

void *malloc(size_t n)
{
	return heap_took(__libc_malloc(n), n);
}

void *calloc(size_t n, size_t size)
{
	return heap_took(__libc_calloc(n, size), n * size);
}

void *aligned_alloc(size_t align, size_t n)
{
	return heap_took(__libc_memalign(align, n), n);
}

void *realloc(void *p, size_t n)
{
	if (p)
		atomic_fetch_sub(&heap_now, malloc_usable_size(p));
	return heap_took(__libc_realloc(p, n), n);
}

void free(void *p)
{
	if (p)
		atomic_fetch_sub(&heap_now, malloc_usable_size(p));
	__libc_free(p);
}
#endif

#endif
