#pragma once

#include <cmath>
#include <cstring>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "camber/cloud/cloud_io.h"
#include "camber/cloud/point_stream.h"
#include "camber/core/errors.h"
#include "camber/core/random.h"

namespace camber::test {

/// A cloud with every attribute that there is.
inline RoadCloud make_full_cloud(std::size_t count, std::uint64_t seed = 1) {
  const CounterRandom random(seed);
  RoadCloud cloud;
  cloud.frame = CloudFrame::kCamera;
  for (std::size_t i = 0; i < count; ++i) {
    const auto number = [&](std::uint64_t k) {
      return static_cast<float>(random.uniform(100 * i + k, -50.0, 50.0));
    };
    cloud.points.emplace_back(number(0), number(1), number(2));
    cloud.colors.push_back({static_cast<std::uint8_t>(random.below(100 * i + 3, 256)),
                            static_cast<std::uint8_t>(random.below(100 * i + 4, 256)),
                            static_cast<std::uint8_t>(random.below(100 * i + 5, 256))});
    cloud.sigmas.push_back(std::abs(number(6)));
    cloud.covariances.push_back(
        {number(7), number(8), number(9), number(10), number(11), number(12)});
    cloud.normals.push_back(Eigen::Vector3f(number(13), number(14), number(15)).normalized());
    cloud.labels["patch"].push_back(static_cast<int>(random.below(100 * i + 16, 7)) - 1);
    cloud.labels["ground"].push_back(static_cast<int>(random.bits(100 * i + 17)));
    cloud.scalars["intensity"].push_back(number(18));
  }
  return cloud;
}

inline std::string write_to_memory(const RoadCloud& cloud, CloudFormat format,
                                   CloudEncoding encoding = CloudEncoding::kBinary) {
  std::ostringstream out;
  const auto source = make_point_source(cloud);
  const auto sink = make_point_sink(out, source->header(), format, encoding);
  PointBatch batch;
  while (source->next(batch)) sink->write(batch);
  sink->finish();
  return out.str();
}

inline CloudFile read_from_memory(const std::string& bytes, const std::string& name,
                                  const ReadOptions& options = {}) {
  return read_cloud_memory(bytes.data(), bytes.size(), name, options);
}

/// The message of the InputError that reading ends in; empty if it succeeds.
inline std::string read_error(const std::string& bytes, const std::string& name,
                              const ReadOptions& options = {}) {
  try {
    read_from_memory(bytes, name, options);
  } catch (const InputError& error) {
    return error.what();
  }
  return {};
}

/// Appends a value's bytes, little or big endian.
template <typename T>
void put(std::string& out, T value, bool big_endian = false) {
  char bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof(T));
  for (std::size_t i = 0; i < sizeof(T); ++i) out += bytes[big_endian ? sizeof(T) - 1 - i : i];
}

}  // namespace camber::test
