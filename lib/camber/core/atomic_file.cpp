#include "camber/core/atomic_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <system_error>

#include "camber/core/detail/paths.h"
#include "camber/core/detail/staging.h"
#include "camber/core/errors.h"
#include "camber/core/folder_files.h"
#include "camber/core/protected_inputs.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

using paths::resolved;

/// Where a link leads; other paths themselves.
fs::path link_target(const fs::path& path) {
  std::error_code error;
  if (!fs::is_symlink(path, error)) return path;
  fs::path target = fs::canonical(path, error);
  return error ? path : target;
}

std::string last_error() { return std::strerror(errno); }

/// Where a folder's old content is between two renames.
fs::path old_name(const fs::path& folder) {
  return folder.parent_path() / ("." + folder.filename().string().substr(0, 180) + ".camber-old");
}

/// Exchanges two names in one step. @return whether it was done; else errno holds the reason.
bool exchange(const fs::path& a, const fs::path& b) {
  return ::renameat2(AT_FDCWD, a.c_str(), AT_FDCWD, b.c_str(), RENAME_EXCHANGE) == 0;
}

/// Whether errno means that this file system, or kernel, has no such step.
bool cannot_exchange() { return errno == EINVAL || errno == ENOSYS || errno == EOPNOTSUPP; }

/// Brings a file or folder to the disk; where the file system knows no such thing nothing happens.
/// @return whether that failed: errno holds the reason.
bool sync_failed(const fs::path& path) {
  const int file = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (file < 0) return true;
  const bool failed =
      ::fsync(file) != 0 && errno != EINVAL && errno != EROFS && errno != EOPNOTSUPP;
  const int reason = errno;
  const bool closed = ::close(file) == 0;
  if (failed) errno = reason;
  return failed || !closed;
}

void sync(const fs::path& path, const std::string& name) {
  if (sync_failed(path)) throw OutputError(name, "writing failed: " + last_error());
}

/// The folder that holds a new name. One that may not be opened is left to the system.
bool sync_parent_failed(const fs::path& path) {
  const fs::path parent = path.parent_path().empty() ? fs::path(".") : path.parent_path();
  return sync_failed(parent) && errno != EACCES;
}

void sync_tree(const fs::path& folder, const std::string& name) {
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (entry.is_symlink()) continue;
    const fs::path shown = fs::path(name) / entry.path().lexically_relative(folder);
    if (entry.is_regular_file() || entry.is_directory()) sync(entry.path(), shown.string());
  }
  sync(folder, name);
}

/// @param name of the file in messages.
void write_stream(const fs::path& path, const std::string& name,
                  const std::function<void(std::ostream&)>& write) {
  errno = 0;
  std::ofstream out(path, std::ios::binary | std::ios::trunc);
  if (!out) throw OutputError(name, "cannot be written: " + last_error());
  write(out);
  out.flush();
  if (out) out.close();
  if (!out) throw OutputError(name, "writing failed" + (errno ? ": " + last_error() : ""));
}

/// Whether the folder that stands at `path` (resolved) may be replaced.
void check_replaceable(const fs::path& path, const std::string& name, bool overwrite,
                       const std::vector<fs::path>& inputs) {
  std::error_code error;
  refuse_protected_folder(name);
  if (!fs::is_directory(path, error)) throw OutputError(name, "a file of that name is there");
  const bool empty = fs::is_empty(path, error);
  if (!empty && !fs::exists(path / "run.json", error) && !overwrite) {
    throw OutputError(name,
                      "the folder is not empty and not a Camber result (no run.json); "
                      "--overwrite replaces it");
  }
  if (paths::lies_in(resolved(fs::current_path(error)), path)) {
    throw OutputError(name, "is, or holds, the current folder; a result replaces its folder");
  }
  for (const fs::path& input : inputs) {
    if (paths::holds_name(path, input)) {
      throw UsageError(name + ": holds the input " + input.string() +
                       ", and a result replaces its folder");
    }
  }
}

/// Whether names can be made in a folder; as far as that can be known without trying.
void check_folder(const fs::path& folder, const std::string& name) {
  const fs::path place = folder.empty() ? fs::path(".") : folder;
  std::error_code error;
  const bool leads_nowhere = fs::exists(place, error) && !fs::is_directory(place, error);
  if (leads_nowhere) errno = ENOTDIR;
  if (leads_nowhere || ::access(place.c_str(), W_OK | X_OK) != 0) {
    throw OutputError(name, "cannot be written: " + last_error());
  }
}

}  // namespace

void write_file_atomically(const fs::path& path, const std::function<void(std::ostream&)>& write) {
  if (path.empty()) throw UsageError("found an empty name, expected a file to write");
  if (is_special_file(path) || staging::holds(path)) {
    write_stream(path, staging::final_name(path).string(), write);
    return;
  }
  AtomicFiles files;
  write_stream(files.stage(path), path.string(), write);
  files.commit();
}

void write_file_atomically(const fs::path& path, const std::string& content) {
  write_file_atomically(path, [&](std::ostream& out) {
    out.write(content.data(), static_cast<std::streamsize>(content.size()));
  });
}

AtomicFiles::~AtomicFiles() { discard(); }

void AtomicFiles::discard() noexcept {
  for (const Staged& file : staged_) staging::discard(file.beside);
  staged_.clear();
}

void check_output_file(const fs::path& path) {
  std::error_code error;
  if (path.empty() || is_special_file(path)) return;
  refuse_protected_file(path);
  if (fs::is_directory(path, error)) {
    throw OutputError(path.string(), "a folder of that name is there");
  }
  check_folder(link_target(path).parent_path(), path.string());
}

void check_output_folder(const fs::path& path, bool overwrite,
                         const std::vector<fs::path>& inputs) {
  if (path.empty()) throw UsageError("found an empty name, expected a folder for the result");
  const fs::path to = resolved(path);
  std::error_code error;
  const bool there = fs::exists(to, error);
  // A mistake of the caller's, not the machine's.
  if (error == std::errc::filename_too_long) throw fs::filesystem_error("output", path, error);
  if (there) check_replaceable(to, path.string(), overwrite, inputs);
  fs::path parent = to.parent_path();  // missing ones will be made
  while (!fs::exists(parent, error) && parent.has_relative_path()) parent = parent.parent_path();
  check_folder(parent, path.string());
}

fs::path AtomicFiles::stage(const fs::path& path) {
  std::error_code error;
  if (path.empty() || is_special_file(path)) return path;  // written directly, or refused then
  refuse_protected_file(path);
  if (fs::is_directory(path, error)) {
    throw OutputError(path.string(), "a folder of that name is there");
  }
  Staged& file = staged_.emplace_back();
  file.path = link_target(path);
  file.name = path.string();
  try {
    file.beside = staging::make_file(file.path, file.name);
  } catch (...) {
    staged_.pop_back();
    throw;
  }
  return file.beside;
}

void AtomicFiles::commit() {
  for (const Staged& file : staged_) sync(file.beside, file.name);
  {
    const staging::Renaming together;
    for (Staged& file : staged_) {
      std::error_code error;
      file.exchanged = fs::is_regular_file(fs::symlink_status(file.path, error)) &&
                       exchange(file.beside, file.path);
      file.appeared = file.exchanged || ::rename(file.beside.c_str(), file.path.c_str()) == 0;
      if (!file.appeared) fail(file.name);
    }
    for (const Staged& file : staged_) {
      if (sync_parent_failed(file.path)) fail(file.name);
    }
  }
  discard();  // the old files
}

void AtomicFiles::fail(const std::string& name) {
  const std::string reason = last_error();
  take_back();
  throw OutputError(name, "cannot be written: " + reason);
}

void AtomicFiles::take_back() {
  for (Staged& file : staged_) {
    if (!file.appeared) continue;
    if (file.exchanged) {
      exchange(file.beside, file.path);
    } else {
      ::rename(file.path.c_str(), file.beside.c_str());
    }
  }
}

AtomicFolder::AtomicFolder(const fs::path& path, bool overwrite,
                           const std::vector<fs::path>& inputs)
    : name_(path.string()), path_(resolved(path)) {
  if (path.empty()) throw UsageError("found an empty name, expected a folder for the result");
  std::error_code error;
  const fs::path old = old_name(path_);
  if (fs::exists(old, error)) {  // a run was killed between two renames
    if (fs::exists(path_, error)) {
      fs::remove_all(old, error);
    } else {
      fs::rename(old, path_, error);
    }
  }
  if (fs::exists(path_, error)) check_replaceable(path_, name_, overwrite, inputs);
  if (path_.has_parent_path()) fs::create_directories(path_.parent_path(), error);
  staging_ = staging::make_folder(path_, name_);
}

AtomicFolder::~AtomicFolder() {
  if (!staging_.empty()) staging::discard(staging_);
}

void AtomicFolder::take_name() {
  std::error_code error;
  if (!fs::exists(path_, error)) {
    if (::rename(staging_.c_str(), path_.c_str()) != 0) fail("cannot be written: ");
    if (!sync_parent_failed(path_)) return;
    const int reason = errno;
    ::rename(path_.c_str(), staging_.c_str());
    errno = reason;
    fail("cannot be written: ");
  }
  if (!fs::is_directory(path_, error)) throw OutputError(name_, "a file of that name is there");
  if (exchange(staging_, path_)) {
    if (!sync_parent_failed(path_)) return;
    const int reason = errno;
    exchange(staging_, path_);
    errno = reason;
    fail("cannot be replaced: ");
  }
  const fs::path old = old_name(path_);
  if (!cannot_exchange() || ::rename(path_.c_str(), old.c_str()) != 0) fail("cannot be replaced: ");
  if (::rename(staging_.c_str(), path_.c_str()) == 0 && !sync_parent_failed(path_)) return;
  const int reason = errno;
  ::rename(path_.c_str(), staging_.c_str());  // where that failure was the disk's
  ::rename(old.c_str(), path_.c_str());
  errno = reason;
  fail("cannot be replaced: ");
}

void AtomicFolder::fail(const char* what) const { throw OutputError(name_, what + last_error()); }

void AtomicFolder::commit() {
  refuse_protected_folder(name_);
  sync_tree(staging_, name_);
  {
    const staging::Renaming at_once;
    take_name();
  }
  // Last, the old result.
  staging::discard(staging_);
  std::error_code ignored;
  fs::remove_all(old_name(path_), ignored);
  staging_.clear();
}

void discard_staged_outputs() noexcept { staging::discard_all(); }

}  // namespace camber
