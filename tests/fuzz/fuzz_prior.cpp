// Any bytes as a prior of vehicle shapes: one that can be asked and written again, or an
// InputError.

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <string>

#include "camber/core/errors.h"
#include "camber/vehicle/shape_prior.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string text(reinterpret_cast<const char*>(data), size);
  try {
    const camber::VehiclePrior prior = camber::parse_vehicle_prior(text, "input");
    prior.shape("car");
    prior.size("truck");
    camber::parse_vehicle_prior(camber::vehicle_prior_text(prior), "copy");
  } catch (const camber::InputError&) {
    // what a reader of untrusted files answers
  }
  return 0;
}
