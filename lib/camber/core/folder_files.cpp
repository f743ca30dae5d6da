#include "camber/core/folder_files.h"

#include "camber/core/errors.h"

namespace fs = std::filesystem;

namespace camber {
namespace {

bool is_special(const fs::file_status& status) {
  return fs::exists(status) && !fs::is_regular_file(status) && !fs::is_directory(status);
}

}  // namespace

bool is_special_file(const fs::path& path) {
  std::error_code error;
  return is_special(fs::status(path, error));
}

std::vector<fs::path> files_in(const fs::path& folder) {
  std::vector<fs::path> files;
  std::error_code error, ignored;
  fs::directory_iterator at(folder, error);
  for (const fs::directory_iterator end; !error && at != end; at.increment(error)) {
    const fs::file_status status = at->status(ignored);
    if (!fs::is_directory(status) && !is_special(status)) files.push_back(at->path());
  }
  if (error) throw InputError(folder.string(), "cannot be listed: " + error.message());
  return files;
}

}  // namespace camber
