#include "camber/scene/surface_file.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>

#include "camber/core/atomic_file.h"
#include "camber/scene/json_reader.h"
#include "camber/scene/results.h"

namespace camber {
namespace {

constexpr std::size_t kAtOnce = 1000;  // patches or links

/// An array of the document, of which elements are made in parts.
template <typename T>
void write_array(std::ostream& out, const std::vector<T>& all, std::vector<T> RoadSurface::*member,
                 const char* key) {
  for (std::size_t begin = 0; begin < all.size(); begin += kAtOnce) {
    const std::size_t end = std::min(all.size(), begin + kAtOnce);
    RoadSurface part;
    (part.*member)
        .assign(all.begin() + static_cast<std::ptrdiff_t>(begin),
                all.begin() + static_cast<std::ptrdiff_t>(end));
    const nlohmann::json document = to_json(part);
    std::size_t i = begin;
    for (const nlohmann::json& element : document.at(key)) {
      out << (i++ == 0 ? "[\n    " : ",\n    ");
      std::string text = format_json(element);
      text.pop_back();
      // Two levels deeper; a line's end within a string is written as an escape.
      for (const char c : text) {
        out << c;
        if (c == '\n') out << "    ";
      }
    }
  }
  out << (all.empty() ? "[]" : "\n  ]");
}

}  // namespace

RoadSurface without_contents(const RoadSurface& surface) {
  RoadSurface out;
  out.frame = surface.frame;
  out.up = surface.up;
  out.level = surface.level;
  out.level_sigma = surface.level_sigma;
  out.metric = surface.metric;
  out.scale_sigma = surface.scale_sigma;
  out.ego_patch = surface.ego_patch;
  out.driven_line = surface.driven_line;
  return out;
}

void write_surface(const RoadSurface& surface, const std::filesystem::path& path) {
  const std::string head = format_json(to_json(without_contents(surface)));
  const auto place_of = [&](const std::string& key) {
    const std::size_t place = head.find("\n  \"" + key + "\": []");
    if (place == std::string::npos) throw std::logic_error("a surface without " + key);
    return place + key.size() + 7;  // of the array
  };
  const std::size_t links = place_of("links"), patches = place_of("patches");
  write_file_atomically(path, [&](std::ostream& out) {
    out << head.substr(0, links);
    write_array(out, surface.links, &RoadSurface::links, "links");
    out << head.substr(links + 2, patches - links - 2);
    write_array(out, surface.patches, &RoadSurface::patches, "patches");
    out << head.substr(patches + 2);
  });
}

}  // namespace camber
