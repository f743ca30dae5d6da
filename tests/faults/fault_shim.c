// Preloaded into the program by the tests: CAMBER_FAULT=KIND:N makes the N-th call of a kind fail,
// or something happen at it.
//   write       ENOSPC, also of fwrite
//   fsync       EIO
//   rename      EIO, also of an exchange
//   kill        SIGKILL before the N-th rename
//   kill-write  SIGKILL before the N-th write
//   alloc       no memory; counted from main on
//   clock       from then on the time of day is a year earlier, the other clocks an hour later
//   shrink      the file that is read, or mapped, loses its second half before the N-th such call
//   read-only   (any N) nothing can be made, renamed or removed below CAMBER_FAULT_FOLDER
// Of shrink only files below CAMBER_FAULT_FOLDER count. CAMBER_FAULT_COUNTS=FILE: how many calls
// there were of each kind goes there at the end. CAMBER_NO_EXCHANGE=1: renameat2 is unknown, as on
// some file systems.
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <sys/uio.h>
#include <time.h>
#include <unistd.h>

enum Kind {
  kWrite,
  kFsync,
  kRename,
  kKill,
  kKillWrite,
  kAlloc,
  kClock,
  kShrink,
  kReadOnly,
  kKinds
};
static const char* const kNames[kKinds] = {"write", "fsync", "rename", "kill",     "kill-write",
                                           "alloc", "clock", "shrink", "read-only"};

static int g_kind = kKinds;  // of the fault; kKinds: none
static int g_at;             // the N-th call
static const char* g_folder = "";
static const char* g_counts;
static int g_no_exchange;
static atomic_int g_early_calls[kKinds];
static atomic_int* g_calls = g_early_calls;
static atomic_int g_in_main;

// The function of that name that this one hides.
#define REAL(result, name, ...)       \
  static result (*real)(__VA_ARGS__); \
  if (!real) *(void**)&real = dlsym(RTLD_NEXT, #name)

__attribute__((constructor)) static void read_environment(void) {
  const char* fault = getenv("CAMBER_FAULT");
  const char* colon = fault ? strrchr(fault, ':') : NULL;
  for (int kind = 0; colon && kind < kKinds; ++kind) {
    const size_t length = strlen(kNames[kind]);
    if ((size_t)(colon - fault) == length && !strncmp(fault, kNames[kind], length)) g_kind = kind;
  }
  if (colon) g_at = atoi(colon + 1);
  if (getenv("CAMBER_FAULT_FOLDER")) g_folder = getenv("CAMBER_FAULT_FOLDER");
  g_counts = getenv("CAMBER_FAULT_COUNTS");
  g_no_exchange = getenv("CAMBER_NO_EXCHANGE") != NULL;
  // Shared: a process that the program forks counts on.
  void* const shared =
      mmap(NULL, sizeof g_early_calls, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  if (shared != MAP_FAILED) g_calls = memcpy(shared, g_early_calls, sizeof g_early_calls);
}

__attribute__((destructor)) static void write_counts(void) {
  if (!g_counts) return;
  g_in_main = 0;
  g_kind = kKinds;
  FILE* out = fopen(g_counts, "w");
  if (!out) return;
  for (int kind = 0; kind < kKinds; ++kind) fprintf(out, "%s %d\n", kNames[kind], g_calls[kind]);
  fclose(out);
}

// Counts a call. Whether it is the one.
static int due(int kind) {
  const int call = atomic_fetch_add(&g_calls[kind], 1) + 1;
  return kind == g_kind && call == g_at;
}

static int fails(int kind, int reason) {
  if (!due(kind)) return 0;
  errno = reason;
  return 1;
}

static int write_fails(int file) {
  if (file <= STDERR_FILENO) return 0;
  if (due(kKillWrite)) raise(SIGKILL);
  return fails(kWrite, ENOSPC);
}

static int rename_fails(void) {
  if (due(kKill)) raise(SIGKILL);
  return fails(kRename, EIO);
}

static int lies_in_folder(const char* path) {
  const size_t length = strlen(g_folder);
  return length > 0 && strncmp(path, g_folder, length) == 0 &&
         (path[length] == '/' || path[length] == '\0');
}

// Whether the folder is read-only and holds that name; the program runs in it.
static int is_read_only(const char* path) {
  if (g_kind != kReadOnly || !path || (path[0] == '/' && !lies_in_folder(path))) return 0;
  errno = EROFS;
  return 1;
}

ssize_t write(int file, const void* data, size_t size) {
  REAL(ssize_t, write, int, const void*, size_t);
  return write_fails(file) ? -1 : real(file, data, size);
}

ssize_t writev(int file, const struct iovec* parts, int count) {
  REAL(ssize_t, writev, int, const struct iovec*, int);
  return write_fails(file) ? -1 : real(file, parts, count);
}

size_t fwrite(const void* data, size_t size, size_t count, FILE* stream) {
  REAL(size_t, fwrite, const void*, size_t, size_t, FILE*);
  return write_fails(fileno(stream)) ? 0 : real(data, size, count, stream);
}

int fsync(int file) {
  REAL(int, fsync, int);
  return fails(kFsync, EIO) ? -1 : real(file);
}

int rename(const char* from, const char* to) {
  REAL(int, rename, const char*, const char*);
  return rename_fails() || is_read_only(to) ? -1 : real(from, to);
}

int renameat2(int a, const char* from, int b, const char* to, unsigned int flags) {
  REAL(int, renameat2, int, const char*, int, const char*, unsigned int);
  if (g_no_exchange) {
    errno = EINVAL;
    return -1;
  }
  return rename_fails() || is_read_only(to) ? -1 : real(a, from, b, to, flags);
}

// --- memory

extern void* __libc_malloc(size_t);
extern void* __libc_calloc(size_t, size_t);
extern void* __libc_realloc(void*, size_t);
extern void* __libc_memalign(size_t, size_t);

static int no_memory(void) { return g_in_main && fails(kAlloc, ENOMEM); }

void* malloc(size_t size) { return no_memory() ? NULL : __libc_malloc(size); }
void* calloc(size_t count, size_t size) { return no_memory() ? NULL : __libc_calloc(count, size); }
void* realloc(void* old, size_t size) { return no_memory() ? NULL : __libc_realloc(old, size); }
void* memalign(size_t to, size_t size) { return no_memory() ? NULL : __libc_memalign(to, size); }
void* aligned_alloc(size_t to, size_t size) { return memalign(to, size); }
int posix_memalign(void** out, size_t to, size_t size) {
  void* const made = memalign(to, size);
  if (!made) return ENOMEM;
  *out = made;
  return 0;
}

typedef int Main(int, char**, char**);
static Main* g_main;

static int counted_main(int argc, char** argv, char** environment) {
  g_in_main = 1;
  const int code = g_main(argc, argv, environment);
  g_in_main = 0;
  return code;
}

int __libc_start_main(Main* main, int argc, char** argv, void (*init)(void), void (*fini)(void),
                      void (*late)(void), void* stack_end) {
  REAL(int, __libc_start_main, Main*, int, char**, void (*)(void), void (*)(void), void (*)(void),
       void*);
  g_main = main;
  return real(counted_main, argc, argv, init, fini, late, stack_end);
}

// --- clocks

static int jumped(void) { return due(kClock) || (g_kind == kClock && g_calls[kClock] > g_at); }

int clock_gettime(clockid_t clock, struct timespec* out) {
  REAL(int, clock_gettime, clockid_t, struct timespec*);
  const int failed = real(clock, out);
  if (!failed && jumped()) out->tv_sec += clock == CLOCK_REALTIME ? -31557600 : 3600;
  return failed;
}

int gettimeofday(struct timeval* out, void* zone) {
  REAL(int, gettimeofday, struct timeval*, void*);
  const int failed = real(out, zone);
  if (!failed && jumped()) out->tv_sec -= 31557600;
  return failed;
}

time_t time(time_t* out) {
  struct timespec now;
  clock_gettime(CLOCK_REALTIME, &now);
  if (out) *out = now.tv_sec;
  return now.tv_sec;
}

// --- files that shrink

static void before_read(int file) {
  if (g_folder[0] == '\0' || file <= STDERR_FILENO) return;
  const int reason = errno;
  char name[64], path[PATH_MAX];
  snprintf(name, sizeof name, "/proc/self/fd/%d", file);
  const ssize_t length = readlink(name, path, sizeof path - 1);
  struct stat status;
  if (length > 0) {
    path[length] = '\0';
    if (lies_in_folder(path) && stat(path, &status) == 0 && S_ISREG(status.st_mode) &&
        due(kShrink) && truncate(path, status.st_size / 2) != 0) {
      abort();
    }
  }
  errno = reason;
}

ssize_t read(int file, void* data, size_t size) {
  REAL(ssize_t, read, int, void*, size_t);
  before_read(file);
  return real(file, data, size);
}

ssize_t pread(int file, void* data, size_t size, off_t at) {
  REAL(ssize_t, pread, int, void*, size_t, off_t);
  before_read(file);
  return real(file, data, size, at);
}
ssize_t pread64(int file, void* data, size_t size, off64_t at) {
  return pread(file, data, size, at);
}

size_t fread(void* data, size_t size, size_t count, FILE* stream) {
  REAL(size_t, fread, void*, size_t, size_t, FILE*);
  before_read(fileno(stream));
  return real(data, size, count, stream);
}

void* mmap(void* at, size_t length, int protection, int flags, int file, off_t offset) {
  REAL(void*, mmap, void*, size_t, int, int, int, off_t);
  void* const out = real(at, length, protection, flags, file, offset);
  if (file >= 0 && !(protection & PROT_EXEC)) before_read(file);
  return out;
}
void* mmap64(void* at, size_t length, int protection, int flags, int file, off64_t offset) {
  return mmap(at, length, protection, flags, file, offset);
}

// --- a folder that is read-only

#define MODE(flags)                        \
  mode_t mode = 0;                         \
  if ((flags) & (O_CREAT | __O_TMPFILE)) { \
    va_list rest;                          \
    va_start(rest, flags);                 \
    mode = va_arg(rest, mode_t);           \
    va_end(rest);                          \
  }

static int may_not_open(const char* path, int flags) {
  return ((flags & O_ACCMODE) != O_RDONLY || (flags & O_CREAT)) && is_read_only(path);
}

int open(const char* path, int flags, ...) {
  REAL(int, open, const char*, int, ...);
  MODE(flags)
  return may_not_open(path, flags) ? -1 : real(path, flags, mode);
}
int open64(const char* path, int flags, ...) {
  MODE(flags)
  return open(path, flags, mode);
}
int openat(int folder, const char* path, int flags, ...) {
  REAL(int, openat, int, const char*, int, ...);
  MODE(flags)
  return may_not_open(path, flags) ? -1 : real(folder, path, flags, mode);
}
int openat64(int folder, const char* path, int flags, ...) {
  MODE(flags)
  return openat(folder, path, flags, mode);
}
FILE* fopen(const char* path, const char* how) {
  REAL(FILE*, fopen, const char*, const char*);
  return strpbrk(how, "wa+") && is_read_only(path) ? NULL : real(path, how);
}
FILE* fopen64(const char* path, const char* how) { return fopen(path, how); }
int mkdir(const char* path, mode_t mode) {
  REAL(int, mkdir, const char*, mode_t);
  return is_read_only(path) ? -1 : real(path, mode);
}
int access(const char* path, int mode) {
  REAL(int, access, const char*, int);
  return (mode & W_OK) && is_read_only(path) ? -1 : real(path, mode);
}
int unlink(const char* path) {
  REAL(int, unlink, const char*);
  return is_read_only(path) ? -1 : real(path);
}
int rmdir(const char* path) {
  REAL(int, rmdir, const char*);
  return is_read_only(path) ? -1 : real(path);
}
int unlinkat(int folder, const char* path, int flags) {
  REAL(int, unlinkat, int, const char*, int);
  return is_read_only(path) ? -1 : real(folder, path, flags);
}
int truncate(const char* path, off_t length) {
  REAL(int, truncate, const char*, off_t);
  return is_read_only(path) ? -1 : real(path, length);
}
