#include "camber/core/atomic_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>

#include "camber/core/errors.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

/// A sibling of `path` that no other process uses.
fs::path sibling(const fs::path& path, const std::string& kind, const std::string& extension = "") {
  static int counter = 0;
  // File systems allow names of 255 bytes.
  const fs::path name = "." + path.filename().string().substr(0, 180) + "." + kind + "." +
                        std::to_string(::getpid()) + "." + std::to_string(counter++) + extension;
  return path.parent_path().empty() ? name : path.parent_path() / name;
}

/// Absolute, without links, "." and "..", and without a slash at the end, as far as it exists.
fs::path resolved(const fs::path& path) {
  std::error_code error;
  fs::path out = fs::weakly_canonical(fs::absolute(path, error), error);
  if (error) out = path;
  return out.has_filename() ? out : out.parent_path();
}

/// Where a link leads; other paths themselves.
fs::path link_target(const fs::path& path) {
  std::error_code error;
  if (!fs::is_symlink(path, error)) return path;
  fs::path target = fs::canonical(path, error);
  return error ? path : target;
}

/// A device, a pipe or a socket: nothing that a file could replace.
bool is_special(const fs::path& path) {
  std::error_code error;
  const fs::file_status status = fs::status(path, error);
  return fs::exists(status) && !fs::is_regular_file(status) && !fs::is_directory(status);
}

/// Whether `path` is `folder` or lies in it; both resolved.
bool lies_in(const fs::path& path, const fs::path& folder) {
  const auto at = std::mismatch(folder.begin(), folder.end(), path.begin(), path.end());
  return at.first == folder.end();
}

std::string last_error() { return std::strerror(errno); }

}  // namespace

void write_file_atomically(const fs::path& path, const std::function<void(std::ostream&)>& write) {
  if (path.empty()) throw UsageError("found an empty name, expected a file to write");
  std::error_code ignored;
  if (fs::is_directory(path, ignored)) {
    throw OutputError(path.string(), "a folder of that name is there");
  }
  const bool special = is_special(path);
  const fs::path target = special ? path : link_target(path);
  const fs::path temporary = special ? path : sibling(target, "part");
  try {
    std::ofstream out(temporary, std::ios::binary | std::ios::trunc);
    if (!out) throw OutputError(path.string(), "cannot be written: " + last_error());
    write(out);
    out.flush();
    if (!out) throw OutputError(path.string(), "writing failed: " + last_error());
    out.close();
    std::error_code error;
    if (!special) fs::rename(temporary, target, error);
    if (error) throw OutputError(path.string(), "cannot be written: " + error.message());
  } catch (...) {
    if (!special) fs::remove(temporary, ignored);
    throw;
  }
}

void write_file_atomically(const fs::path& path, const std::string& content) {
  write_file_atomically(path, [&](std::ostream& out) {
    out.write(content.data(), static_cast<std::streamsize>(content.size()));
  });
}

AtomicFiles::~AtomicFiles() {
  std::error_code ignored;
  for (const auto& [beside, path] : staged_) fs::remove(beside, ignored);
}

fs::path AtomicFiles::stage(const fs::path& path) {
  std::error_code error;
  if (path.empty() || is_special(path)) return path;  // written directly, or refused then
  if (fs::is_directory(path, error)) {
    throw OutputError(path.string(), "a folder of that name is there");
  }
  const fs::path target = link_target(path);
  staged_.emplace_back(sibling(target, "part", target.extension().string()), target);
  if (!std::ofstream(staged_.back().first)) {
    throw OutputError(path.string(), "cannot be written: " + last_error());
  }
  return staged_.back().first;
}

void AtomicFiles::commit() {
  for (const auto& [beside, path] : staged_) {
    std::error_code error;
    fs::rename(beside, path, error);
    if (error) throw OutputError(path.string(), "cannot be written: " + error.message());
  }
  staged_.clear();
}

AtomicFolder::AtomicFolder(const fs::path& path, bool overwrite,
                           const std::vector<fs::path>& inputs)
    : name_(path.string()), path_(resolved(path)) {
  if (path.empty()) throw UsageError("found an empty name, expected a folder for the result");
  std::error_code error;
  if (fs::exists(path_, error)) {
    if (!fs::is_directory(path_, error)) throw OutputError(name_, "a file of that name is there");
    const bool empty = fs::is_empty(path_, error);
    if (!empty && !fs::exists(path_ / "run.json", error) && !overwrite) {
      throw OutputError(name_,
                        "the folder is not empty and not a Camber result (no run.json); "
                        "--overwrite replaces it");
    }
    if (lies_in(resolved(fs::current_path(error)), path_)) {
      throw OutputError(name_, "is, or holds, the current folder; a result replaces its folder");
    }
    for (const fs::path& input : inputs) {
      if (!input.empty() && lies_in(resolved(input), path_)) {
        throw UsageError(name_ + ": holds the input " + input.string() +
                         ", and a result replaces its folder");
      }
    }
  }
  if (path_.has_parent_path()) fs::create_directories(path_.parent_path(), error);
  staging_ = sibling(path_, "part");
  if (!fs::create_directory(staging_, error)) {
    throw OutputError(name_, "cannot be written: " + (error ? error.message() : "name in use"));
  }
}

AtomicFolder::~AtomicFolder() {
  std::error_code ignored;
  if (!staging_.empty()) fs::remove_all(staging_, ignored);
}

void AtomicFolder::commit() {
  std::error_code error;
  if (fs::exists(path_, error)) {
    // Two renames: a reader never sees a mixture, and the old result is deleted last.
    const fs::path old = sibling(path_, "old");
    fs::rename(path_, old, error);
    if (error) throw OutputError(name_, "cannot be replaced: " + error.message());
    fs::rename(staging_, path_, error);
    if (error) {
      std::error_code ignored;
      fs::rename(old, path_, ignored);
      throw OutputError(name_, "cannot be replaced: " + error.message());
    }
    fs::remove_all(old, error);
  } else {
    fs::rename(staging_, path_, error);
    if (error) throw OutputError(name_, "cannot be written: " + error.message());
  }
  staging_.clear();
}

}  // namespace camber
