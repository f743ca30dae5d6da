#pragma once

#include <filesystem>
#include <optional>

#include "camber/pipeline/network_choice.h"
#include "convert.h"

/// What functions that run networks take last but for seed, threads and progress, in this order.
#define CAMBER_NETWORK_ARGUMENTS                                                                 \
  py::arg("detector") = "", py::arg("detector_config") = "", py::arg("segmenter") = "",          \
  py::arg("segmenter_config") = "", py::arg("keypoints") = "", py::arg("keypoints_config") = "", \
  py::arg("cache") = py::none()

namespace camber::python {

inline NetworkChoice network_choice(const std::filesystem::path& detector,
                                    const std::filesystem::path& detector_config,
                                    const std::filesystem::path& segmenter,
                                    const std::filesystem::path& segmenter_config,
                                    const std::filesystem::path& keypoints,
                                    const std::filesystem::path& keypoints_config,
                                    const std::optional<std::filesystem::path>& cache) {
  NetworkChoice out;
  out.detector = detector.string();
  out.detector_config = detector_config.string();
  out.segmenter = segmenter.string();
  out.segmenter_config = segmenter_config.string();
  out.keypoints = keypoints.string();
  out.keypoints_config = keypoints_config.string();
  if (cache) out.cache = *cache;
  return out;
}

}  // namespace camber::python
