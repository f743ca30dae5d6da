#pragma once

// What this process is writing: files and folders under temporary names beside their final ones.
// A temporary is called ".NAME.camber.PID.N" (a file's has NAME's extension after that), and is
// locked (flock) as long as its process lives, so that a later run recognises what a killed one
// left.

#include <filesystem>
#include <mutex>
#include <string>

namespace camber::staging {

/// Makes an empty file, or a folder, beside `target`, and removes what killed processes left there.
/// @param name of the result, for messages. @throws OutputError
std::filesystem::path make_file(const std::filesystem::path& target, const std::string& name);
std::filesystem::path make_folder(const std::filesystem::path& target, const std::string& name);

/// Removes a temporary, file or folder, if it is still there, and forgets it.
void discard(const std::filesystem::path& temporary) noexcept;

/// Whether `path` is a temporary of this process or lies in one.
bool holds(const std::filesystem::path& path);

/// The name that `path` has once it is committed; other paths themselves.
std::filesystem::path final_name(const std::filesystem::path& path);

/// Makes a folder under its own name, with those above it that are missing.
/// @return the topmost that was made, empty where all were there: discard_all() removes it, with
///         all in it, until it is kept.
/// @throws OutputError.
std::filesystem::path make_folders(const std::filesystem::path& folder);
void discard_folders(const std::filesystem::path& topmost) noexcept;
void keep_folders(const std::filesystem::path& topmost) noexcept;

/// While it lives, discard_all() waits: renames that belong together happen all or none. Blocks for
/// good once discard_all() has begun.
class Renaming {
 public:
  Renaming();

 private:
  std::unique_lock<std::recursive_mutex> lock_;
};

/// Removes all temporaries and the folders that are not kept; from then on no more can be made nor
/// given their final names, whoever tries waits for good. For a process that is about to end while
/// it still computes.
void discard_all() noexcept;

}  // namespace camber::staging
