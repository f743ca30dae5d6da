#include "package/layering.h"

#include <algorithm>
#include <fstream>
#include <functional>
#include <regex>
#include <set>

namespace fs = std::filesystem;

namespace camber::test {
namespace {

/// Position of a folder in the order; -1: none.
int rank_of(const std::string& folder) {
  const auto& order = folder_order();
  const auto found = std::find(order.begin(), order.end(), folder);
  return found == order.end() ? -1 : static_cast<int>(found - order.begin());
}

struct Include {
  int line = 0;
  std::string name;
  bool quoted = false;
};

std::vector<Include> read_includes(const fs::path& file) {
  static const std::regex pattern(R"(^\s*#\s*include\s*([<"])([^>"]+)[>"])");
  std::vector<Include> includes;
  std::ifstream in(file);
  std::string text;
  for (int line = 1; std::getline(in, text); ++line) {
    std::smatch match;
    if (std::regex_search(text, match, pattern)) {
      includes.push_back({line, match[2], match[1] == "\""});
    }
  }
  return includes;
}

bool starts_with(const std::string& text, const std::string& prefix) {
  return text.compare(0, prefix.size(), prefix) == 0;
}

/// The sources below `root`/camber, as paths relative to `root`, sorted.
std::vector<std::string> source_files(const fs::path& root) {
  std::vector<std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(root / "camber")) {
    const std::string extension = entry.path().extension().string();
    if (entry.is_regular_file() && (extension == ".h" || extension == ".cpp")) {
      files.push_back(entry.path().lexically_relative(root).generic_string());
    }
  }
  std::sort(files.begin(), files.end());
  return files;
}

/// "camber/road/x.h" -> "road"
std::string folder_of(const std::string& file) {
  const std::string below = file.substr(std::string("camber/").size());
  return below.substr(0, below.find('/'));
}

/// "camber::road" or "camber_road" -> "road"; empty for others.
std::string module_of(const std::string& target) {
  return starts_with(target, "camber::") || starts_with(target, "camber_")
             ? target.substr(target[6] == ':' ? 8 : 7)
             : "";
}

/// "vehicle_paper", the target of vehicle/paper alone, -> "vehicle".
std::string folder_of_module(const std::string& module) {
  return module.substr(0, module.find('_'));
}

}  // namespace

const std::vector<std::string>& folder_order() {
  static const std::vector<std::string> order{
      "core",        "geometry", "image",   "cloud",  "plane",    "road",   "motion",
      "photometric", "scale",    "vehicle", "detect", "scene",    "import", "calibrate",
      "evaluate",    "export",   "render",  "synth",  "pipeline", "drive",  "tiles"};
  return order;
}

std::vector<std::string> include_violations(const fs::path& root) {
  std::vector<std::string> violations;
  std::map<std::string, std::vector<std::string>> graph;  // file -> files of ours it includes
  const std::vector<std::string> files = source_files(root);
  for (const std::string& file : files) {
    const std::string folder = folder_of(file);
    const int rank = rank_of(folder);
    if (rank < 0) violations.push_back(file + ": folder " + folder + " is not in the layout");
    for (const Include& include : read_includes(root / file)) {
      const std::string where = file + ":" + std::to_string(include.line) + ": ";
      // The adapter is the one header that names PCL's types.
      const bool is_header = fs::path(file).extension() == ".h" && file != "camber/cloud/pcl.h";
      if (is_header && (starts_with(include.name, "pcl/") || starts_with(include.name, "vtk"))) {
        violations.push_back(where + include.name + " belongs into a .cpp file");
      }
      std::string target;
      if (starts_with(include.name, "camber/")) {
        target = include.name;
        if (!fs::is_regular_file(root / target)) {
          violations.push_back(where + "no file " + target);
          continue;
        }
      } else if (include.quoted) {
        const fs::path beside = (fs::path(file).parent_path() / include.name).lexically_normal();
        if (!fs::is_regular_file(root / beside)) {
          violations.push_back(where + "no file " + include.name + " beside it");
          continue;
        }
        target = beside.generic_string();
      } else {
        continue;  // a library's header
      }
      graph[file].push_back(target);
      const std::string target_folder = folder_of(target);
      if (rank >= 0 && target_folder != folder && rank_of(target_folder) >= rank) {
        violations.push_back(where + folder + " includes " + target + ", but " + target_folder +
                             " stands below it in the layout");
      }
    }
  }

  // Cycles of files: depth first, a file met again while it is still open closes one.
  std::map<std::string, int> state;  // 0 unseen, 1 open, 2 done
  std::vector<std::string> path;
  const std::function<void(const std::string&)> visit = [&](const std::string& file) {
    state[file] = 1;
    path.push_back(file);
    for (const std::string& next : graph[file]) {
      if (state[next] == 1) {
        std::string cycle;
        for (auto at = std::find(path.begin(), path.end(), next); at != path.end(); ++at) {
          cycle += *at + " -> ";
        }
        violations.push_back("cycle: " + cycle + next);
      } else if (state[next] == 0) {
        visit(next);
      }
    }
    path.pop_back();
    state[file] = 2;
  };
  for (const std::string& file : files) {
    if (state[file] == 0) visit(file);
  }
  std::sort(violations.begin(), violations.end());
  return violations;
}

std::vector<std::string> link_violations(
    const std::map<std::string, std::vector<std::string>>& links) {
  std::vector<std::string> violations;
  for (const auto& [folder, names] : links) {
    const std::string own = folder_of_module(folder);
    const int rank = rank_of(own);
    if (rank < 0) violations.push_back("target " + folder + " is not in the layout");
    for (const std::string& name : names) {
      const std::string other = module_of(name);
      if (other.empty() || (other == own && other != folder)) continue;
      const int other_rank = rank_of(folder_of_module(other));
      if (other_rank < 0 || other_rank >= rank) {
        violations.push_back("target " + folder + " links " + other +
                             ", which does not stand above it in the layout");
      }
    }
  }
  return violations;
}

std::vector<std::string> unlinked_includes(
    const fs::path& root, const std::map<std::string, std::vector<std::string>>& links) {
  std::map<std::string, std::set<std::string>> reached;  // folder -> folders that its target links
  const std::function<void(const std::string&, const std::string&)> reach =
      [&](const std::string& from, const std::string& folder) {
        const auto found = links.find(folder);
        if (found == links.end()) return;
        for (const std::string& name : found->second) {
          const std::string next = module_of(name);
          if (!next.empty() && reached[from].insert(next).second) reach(from, next);
        }
      };
  for (const auto& [folder, names] : links) reach(folder, folder);

  std::set<std::string> violations;
  for (const std::string& file : source_files(root)) {
    const std::string folder = folder_of(file);
    if (links.count(folder) == 0) continue;
    for (const Include& include : read_includes(root / file)) {
      if (!starts_with(include.name, "camber/")) continue;
      const std::string used = folder_of(include.name);
      if (used != folder && reached[folder].count(used) == 0) {
        violations.insert("target " + folder + " includes files of " + used +
                          " but does not link it");
      }
    }
  }
  return {violations.begin(), violations.end()};
}

}  // namespace camber::test
