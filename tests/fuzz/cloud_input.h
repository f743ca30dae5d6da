#pragma once

#include <cstdint>
#include <cstdlib>

#include "camber/cloud/cloud_io.h"
#include "camber/core/errors.h"

/// Reads any bytes as a cloud of one format, strictly and leniently: either a cloud whose arrays
/// agree, or an InputError.
inline void read_as_cloud(const std::uint8_t* data, std::size_t size, camber::CloudFormat format,
                          const char* name = "input") {
  for (const bool lenient : {false, true}) {
    camber::ReadOptions options;
    options.format = format;
    options.lenient = lenient;
    options.triangles = true;
    try {
      const camber::CloudFile file = camber::read_cloud_memory(data, size, name, options);
      file.cloud.validate();
      for (const auto& triangle : file.triangles) {
        for (const std::uint32_t index : triangle) {
          if (index >= file.cloud.size()) std::abort();
        }
      }
    } catch (const camber::InputError&) {
      // what a reader of untrusted files answers
    }
  }
}
