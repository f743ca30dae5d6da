#include "camber/core/atomic_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <fstream>

#include "camber/core/errors.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

/// A sibling of `path` that no other process uses.
fs::path sibling(const fs::path& path, const char* kind) {
  static int counter = 0;
  const fs::path name = "." + path.filename().string() + "." + kind + "." +
                        std::to_string(::getpid()) + "." + std::to_string(counter++);
  return path.parent_path().empty() ? name : path.parent_path() / name;
}

fs::path without_trailing_slash(const fs::path& path) {
  return path.has_filename() ? path : path.parent_path();
}

std::string last_error() { return std::strerror(errno); }

}  // namespace

void write_file_atomically(const fs::path& path, const std::function<void(std::ostream&)>& write) {
  if (fs::is_directory(path)) throw OutputError(path.string(), "a folder of that name is there");
  const fs::path temporary = sibling(path, "part");
  std::error_code ignored;
  try {
    std::ofstream out(temporary, std::ios::binary | std::ios::trunc);
    if (!out) throw OutputError(path.string(), "cannot be written: " + last_error());
    write(out);
    out.flush();
    if (!out) throw OutputError(path.string(), "writing failed: " + last_error());
    out.close();
    std::error_code error;
    fs::rename(temporary, path, error);
    if (error) throw OutputError(path.string(), "cannot be written: " + error.message());
  } catch (...) {
    fs::remove(temporary, ignored);
    throw;
  }
}

void write_file_atomically(const fs::path& path, const std::string& content) {
  write_file_atomically(path, [&](std::ostream& out) {
    out.write(content.data(), static_cast<std::streamsize>(content.size()));
  });
}

AtomicFolder::AtomicFolder(const fs::path& path, bool overwrite)
    : path_(without_trailing_slash(path)) {
  std::error_code error;
  if (fs::exists(path_, error)) {
    if (!fs::is_directory(path_)) throw OutputError(path_.string(), "a file of that name is there");
    const bool empty = fs::is_empty(path_, error);
    if (!empty && !fs::exists(path_ / "run.json") && !overwrite) {
      throw OutputError(path_.string(),
                        "the folder is not empty and not a Camber result (no run.json); "
                        "--overwrite replaces it");
    }
  }
  if (path_.has_parent_path()) fs::create_directories(path_.parent_path(), error);
  staging_ = sibling(path_, "part");
  if (!fs::create_directory(staging_, error)) {
    throw OutputError(path_.string(),
                      "cannot be written: " + (error ? error.message() : "name in use"));
  }
}

AtomicFolder::~AtomicFolder() {
  std::error_code ignored;
  if (!staging_.empty()) fs::remove_all(staging_, ignored);
}

void AtomicFolder::commit() {
  std::error_code error;
  if (fs::exists(path_)) {
    // Two renames: a reader never sees a mixture, and the old result is deleted last.
    const fs::path old = sibling(path_, "old");
    fs::rename(path_, old, error);
    if (error) throw OutputError(path_.string(), "cannot be replaced: " + error.message());
    fs::rename(staging_, path_, error);
    if (error) {
      std::error_code ignored;
      fs::rename(old, path_, ignored);
      throw OutputError(path_.string(), "cannot be replaced: " + error.message());
    }
    fs::remove_all(old, error);
  } else {
    fs::rename(staging_, path_, error);
    if (error) throw OutputError(path_.string(), "cannot be written: " + error.message());
  }
  staging_.clear();
}

}  // namespace camber
