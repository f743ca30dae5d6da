#pragma once

#include <filesystem>
#include <functional>
#include <ostream>
#include <string>

namespace camber {

/// Writes a whole file beside its final name, then renames it: under `path` stands either the old
/// file or the complete new one. @throws OutputError (path, reason).
void write_file_atomically(const std::filesystem::path& path,
                           const std::function<void(std::ostream&)>& write);
void write_file_atomically(const std::filesystem::path& path, const std::string& content);

/// A result folder that appears whole. Files are written under staging(); commit() swaps it with
/// the folder at `path`. Without commit() nothing of it remains and what stood there is untouched.
class AtomicFolder {
 public:
  /// @param overwrite allow to replace a non-empty folder that is not a Camber result (one that
  ///                  has a run.json).
  /// @throws OutputError if a foreign non-empty folder or a file stands there, or it is not
  ///         writable.
  AtomicFolder(const std::filesystem::path& path, bool overwrite);
  ~AtomicFolder();
  AtomicFolder(const AtomicFolder&) = delete;
  AtomicFolder& operator=(const AtomicFolder&) = delete;

  const std::filesystem::path& staging() const { return staging_; }
  void commit();

 private:
  std::filesystem::path path_;
  std::filesystem::path staging_;
};

}  // namespace camber
