#include "camber/core/detail/staging.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <charconv>
#include <csignal>
#include <cstring>
#include <map>
#include <new>
#include <set>

#include "camber/core/errors.h"

namespace fs = std::filesystem;

namespace camber::staging {
namespace {

constexpr char kMark[] = ".camber.";
constexpr std::size_t kMostLocks = 200;  // a process may have 1024 files open

struct Temporary {
  fs::path target;
  int lock = -1;  // file descriptor
};

struct Registry {
  // Recursive: where the standard library has no memory within its noexcept functions, the program
  // ends through discard_all() on the thread that holds it.
  std::recursive_mutex mutex;
  bool closed = false;  // by discard_all()
  unsigned counter = 0;
  std::map<fs::path, Temporary> temporaries;
  std::set<fs::path> folders;  // made under their own names, absolute
  std::set<fs::path> swept;    // folders
};

/// Never destroyed: other threads may use it while the process ends.
Registry& registry() {
  static Registry* const all = new Registry;
  return *all;
}

std::unique_lock<std::recursive_mutex> lock_registry() {
  std::unique_lock<std::recursive_mutex> lock(registry().mutex);
  while (registry().closed) ::pause();
  return lock;
}

/// The process that made a temporary of that name; 0: the name is of another kind.
long maker_of(const std::string& name) {
  const std::size_t mark = name.rfind(kMark);
  if (name.empty() || name[0] != '.' || mark == std::string::npos || mark == 0) return 0;
  const char* at = name.data() + mark + sizeof kMark - 1;
  const char* const end = name.data() + name.size();
  long process = 0;
  unsigned number = 0;
  const auto first = std::from_chars(at, end, process);
  if (first.ec != std::errc() || first.ptr == end || *first.ptr != '.') return 0;
  const auto second = std::from_chars(first.ptr + 1, end, number);
  if (second.ec != std::errc() || (second.ptr != end && *second.ptr != '.')) return 0;
  return process > 0 ? process : 0;
}

/// Whether nobody has it locked. Where locks are not known, it is free.
bool is_free(const fs::path& path) {
  const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
  if (file < 0) return false;
  const bool locked = ::flock(file, LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK;
  ::close(file);
  return !locked;
}

/// Removes what killed processes left in a folder; once a folder and process.
void sweep(const fs::path& folder) {
  if (!registry().swept.insert(folder).second) return;
  std::error_code error;
  std::set<fs::path> left;
  for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) {
    const long process = maker_of(at->path().filename().string());
    if (process == 0 || process == ::getpid()) continue;
    const bool dead = ::kill(static_cast<pid_t>(process), 0) != 0 && errno == ESRCH;
    if (dead && is_free(at->path())) left.insert(at->path());
  }
  for (const fs::path& path : left) fs::remove_all(path, error);
}

fs::path make(const fs::path& target, const std::string& name, bool folder) {
  const auto lock = lock_registry();
  Registry& all = registry();
  const fs::path parent = target.parent_path().empty() ? fs::path(".") : target.parent_path();
  sweep(parent);
  // File systems allow names of 255 bytes.
  fs::path path =
      target.parent_path() / ("." + target.filename().string().substr(0, 180) + kMark +
                              std::to_string(::getpid()) + "." + std::to_string(all.counter++));
  if (!folder) path += target.extension().string().substr(0, 16);
  Temporary& made = all.temporaries[path];  // first what may find no memory
  made.target = target;
  if (folder) {
    if (::mkdir(path.c_str(), 0777) == 0) made.lock = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  } else {
    made.lock = ::open(path.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
  }
  if (made.lock < 0) {
    const int reason = errno;
    if (folder && reason != EEXIST) ::rmdir(path.c_str());
    all.temporaries.erase(path);
    throw OutputError(name, std::string("cannot be written: ") + std::strerror(reason));
  }
  ::flock(made.lock, LOCK_SH | LOCK_NB);  // where locks are not known, the process number remains
  if (all.temporaries.size() > kMostLocks) {
    ::close(made.lock);
    made.lock = -1;
  }
  return path;
}

void remove_tree(const fs::path& path) noexcept {
  // A thread that still computes may put a file into a folder that is being removed.
  for (int attempt = 0; attempt < 5; ++attempt) {
    try {
      std::error_code error;
      fs::remove_all(path, error);
      if (!error) return;
    } catch (const std::bad_alloc&) {  // the next run removes it
    }
  }
}

std::map<fs::path, Temporary>::const_iterator holder_of(const fs::path& path) {
  const auto& all = registry().temporaries;
  if (all.empty()) return all.end();
  for (fs::path at = path; !at.empty(); at = at.parent_path()) {
    const auto found = all.find(at);
    if (found != all.end()) return found;
    if (!at.has_relative_path()) break;
  }
  return all.end();
}

}  // namespace

fs::path make_file(const fs::path& target, const std::string& name) {
  return make(target, name, false);
}
fs::path make_folder(const fs::path& target, const std::string& name) {
  return make(target, name, true);
}

void discard(const fs::path& temporary) noexcept {
  const auto lock = lock_registry();
  const auto at = registry().temporaries.find(temporary);
  if (at == registry().temporaries.end()) return;
  remove_tree(temporary);
  if (at->second.lock >= 0) ::close(at->second.lock);
  registry().temporaries.erase(at);
}

bool holds(const fs::path& path) {
  const auto lock = lock_registry();
  return holder_of(path) != registry().temporaries.end();
}

fs::path final_name(const fs::path& path) {
  const auto lock = lock_registry();
  const auto at = holder_of(path);
  if (at == registry().temporaries.end()) return path;
  if (path == at->first) return at->second.target;
  return at->second.target / path.lexically_relative(at->first);
}

fs::path make_folders(const fs::path& folder) {
  const auto lock = lock_registry();
  std::error_code error;
  fs::path first;
  for (fs::path at = fs::absolute(folder, error).lexically_normal();
       !at.empty() && !fs::exists(at, error); at = at.parent_path()) {
    if (at.has_filename()) first = at;
    if (at == at.parent_path()) break;
  }
  if (!first.empty()) registry().folders.insert(first);  // first what may find no memory
  fs::create_directories(folder, error);
  if (fs::is_directory(folder)) return first;
  discard_folders(first);
  throw OutputError(folder.string(),
                    "cannot be created" + (error ? ": " + error.message() : std::string()));
}

void discard_folders(const fs::path& topmost) noexcept {
  const auto lock = lock_registry();
  if (registry().folders.erase(topmost) > 0) remove_tree(topmost);
}

void keep_folders(const fs::path& topmost) noexcept {
  const auto lock = lock_registry();
  registry().folders.erase(topmost);
}

Renaming::Renaming() : lock_(lock_registry()) {}

void discard_all() noexcept {
  const std::lock_guard<std::recursive_mutex> lock(registry().mutex);
  registry().closed = true;
  for (const auto& [path, temporary] : registry().temporaries) remove_tree(path);
  for (const fs::path& folder : registry().folders) remove_tree(folder);
}

}  // namespace camber::staging
