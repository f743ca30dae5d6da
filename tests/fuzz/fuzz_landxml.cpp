// Any bytes as a LandXML file: alignments of finite places, at least two each, or an InputError.

#include <cstdlib>
#include <string>

#include "camber/core/errors.h"
#include "camber/import/formats/landxml.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  try {
    const camber::LandXmlFile file = camber::read_landxml_text(
        std::string(reinterpret_cast<const char*>(data), size), "landxml");
    if (file.alignments.empty() || !(file.metres > 0.0)) std::abort();
    for (const camber::LandXmlAlignment& alignment : file.alignments) {
      if (alignment.points.size() < 2) std::abort();
      for (const Eigen::Vector3d& place : alignment.points) {
        if (!place.head<2>().allFinite()) std::abort();
      }
    }
  } catch (const camber::InputError&) {
    // what a reader of untrusted files answers
  }
  return 0;
}
