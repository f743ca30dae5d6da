#pragma once

#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace camber::test {

/// The folders of lib/camber, from the bottom up: a folder may use those above it in this list
/// (earlier ones), never itself through another nor those below.
const std::vector<std::string>& folder_order();

/// Reads every .h and .cpp file below `root`/camber and follows #include "camber/..." and
/// <camber/...>, resolved against `root`, and quoted names beside the including file.
/// @return one sentence per violation, sorted; empty if there is none:
///  - a folder that is not in folder_order();
///  - a file that includes a file of a folder that does not stand earlier in the order;
///  - an include that names no file;
///  - a cycle of files that include each other;
///  - a header that includes PCL's or VTK's headers, which belong into .cpp files (but for the
///    adapter cloud/pcl.h).
std::vector<std::string> include_violations(const std::filesystem::path& root);

/// Checks what each module's target links, folder -> names linked (camber::NAME or camber_NAME
/// count, others do not), against folder_order(). A folder within a module may have a target of its
/// own, camber_MODULE_FOLDER, which may link that of the module. @return one sentence per
/// violation.
std::vector<std::string> link_violations(
    const std::map<std::string, std::vector<std::string>>& links);

/// Checks that the target of each folder links, itself or through others, the targets of the
/// folders whose files it includes. Folders below `root`/camber without an entry in `links` are not
/// built and not checked. @return one sentence per violation.
std::vector<std::string> unlinked_includes(
    const std::filesystem::path& root,
    const std::map<std::string, std::vector<std::string>>& links);

}  // namespace camber::test
