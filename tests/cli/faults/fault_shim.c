// Preloaded into the program by the tests: CAMBER_FAULT=KIND:N makes the N-th call of a kind fail,
// or kills the process at it. Kinds: write (ENOSPC), fsync (EIO), rename (EIO), kill (SIGKILL before
// the N-th rename). CAMBER_NO_EXCHANGE=1: renameat2 is unknown, as on some file systems.
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/uio.h>
#include <unistd.h>

static atomic_int g_calls;

// Whether this call of that kind is the one.
static int due(const char* kind) {
  const char* fault = getenv("CAMBER_FAULT");
  const size_t length = strlen(kind);
  if (!fault || strncmp(fault, kind, length) != 0 || fault[length] != ':') return 0;
  return atomic_fetch_add(&g_calls, 1) + 1 == atoi(fault + length + 1);
}

static int fails(const char* kind, int reason) {
  if (!due(kind)) return 0;
  errno = reason;
  return 1;
}

ssize_t write(int file, const void* data, size_t size) {
  static ssize_t (*real)(int, const void*, size_t);
  if (!real) *(void**)&real = dlsym(RTLD_NEXT, "write");
  if (file > STDERR_FILENO && fails("write", ENOSPC)) return -1;
  return real(file, data, size);
}

ssize_t writev(int file, const struct iovec* parts, int count) {
  static ssize_t (*real)(int, const struct iovec*, int);
  if (!real) *(void**)&real = dlsym(RTLD_NEXT, "writev");
  if (file > STDERR_FILENO && fails("write", ENOSPC)) return -1;
  return real(file, parts, count);
}

int fsync(int file) {
  static int (*real)(int);
  if (!real) *(void**)&real = dlsym(RTLD_NEXT, "fsync");
  return fails("fsync", EIO) ? -1 : real(file);
}

int rename(const char* from, const char* to) {
  static int (*real)(const char*, const char*);
  if (!real) *(void**)&real = dlsym(RTLD_NEXT, "rename");
  if (due("kill")) raise(SIGKILL);
  return fails("rename", EIO) ? -1 : real(from, to);
}

int renameat2(int a, const char* from, int b, const char* to, unsigned int flags) {
  static int (*real)(int, const char*, int, const char*, unsigned int);
  if (!real) *(void**)&real = dlsym(RTLD_NEXT, "renameat2");
  if (getenv("CAMBER_NO_EXCHANGE")) {
    errno = EINVAL;
    return -1;
  }
  if (due("kill")) raise(SIGKILL);
  return fails("rename", EIO) ? -1 : real(a, from, b, to, flags);
}
