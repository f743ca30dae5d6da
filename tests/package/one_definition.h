#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace camber::test {

/// Reads every .h and .cpp file below `folders` of `root` and looks for classes, structs, unions
/// and enumerations that are defined at namespace scope under one full name in more than one file.
/// The linker keeps one definition of each inline member of such a name and says nothing. Names in
/// anonymous namespaces and in anything but a namespace do not count; a name may be defined twice
/// in one file (branches of a condition).
/// @return one sentence per violation, sorted; also for files whose braces do not balance.
std::vector<std::string> repeated_definitions(const std::filesystem::path& root,
                                              const std::vector<std::string>& folders);

}  // namespace camber::test
