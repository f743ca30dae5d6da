#include "camber/core/detail/paths.h"

#include <algorithm>
#include <system_error>

namespace fs = std::filesystem;

namespace camber::paths {

fs::path resolved(const fs::path& path) {
  std::error_code error;
  fs::path out = fs::weakly_canonical(fs::absolute(path, error), error);
  if (error) out = path;
  return out.has_filename() ? out : out.parent_path();
}

bool lies_in(const fs::path& path, const fs::path& folder) {
  const auto at = std::mismatch(folder.begin(), folder.end(), path.begin(), path.end());
  return at.first == folder.end();
}

bool holds_name(const fs::path& folder, const fs::path& name) {
  if (name.empty()) return false;
  if (lies_in(resolved(name), folder)) return true;
  if (name.filename() == "." || name.filename() == "..") return false;
  std::error_code error;
  return lies_in(resolved(fs::absolute(name, error).parent_path()), folder);
}

}  // namespace camber::paths
