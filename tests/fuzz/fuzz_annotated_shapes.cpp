// Any bytes as annotated shapes (CSV): finite keypoints, from which a prior can be learnt or not,
// or an InputError.

#include <cstdlib>
#include <stdexcept>

#include "camber/vehicle/annotated_shapes.h"
#include "memory_file.h"
#include "read_or_refuse.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const MemoryFile file(data, size);
  read_or_refuse([&] {
    const std::vector<camber::AnnotatedShape> shapes = camber::read_annotated_shapes(file.path());
    for (const camber::AnnotatedShape& shape : shapes) {
      if (!shape.keypoints.allFinite()) std::abort();
    }
    try {
      camber::learn_annotated_prior("car", shapes, camber::shipped_vehicle_prior().shape("car"),
                                    nullptr, {1});
    } catch (const std::invalid_argument&) {
      // too few that are vehicles
    }
  });
  return 0;
}
