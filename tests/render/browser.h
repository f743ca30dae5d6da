#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace camber::test {

/// The path of Chromium; empty where it is not installed.
std::string find_browser();

/// Loads a page of `folder` without network and gives back its DOM after its scripts; messages go
/// to log.txt.
std::string load_page(const std::string& browser, const std::filesystem::path& folder,
                      const std::string& name, const std::string& more = "");

/// What a page said on its console, by a log; what test probes cause themselves is left out.
std::vector<std::string> complaints(const std::string& log);

}  // namespace camber::test
