// Time of the joint problem over ten vehicles and their planes, one thread, with its set-up:
// analytic derivatives against their automatic twin in one run; and of the starts. Processor time,
// the least of several repeats. The seed is that of the simulated vehicles.

#include <algorithm>
#include <cstdio>
#include <functional>
#include <string>

#include "benchmarks/cpu_time.h"
#include "benchmarks/report.h"
#include "camber/vehicle/paper/joint_fit.h"
#include "vehicle/simulated_vehicle.h"

namespace camber {
namespace {

double least_ms(int repeats, const std::function<void()>& work) {
  double least = 1e9;
  for (int i = 0; i < repeats; ++i) {
    const double begin = bench::cpu_ms();
    work();
    least = std::min(least, bench::cpu_ms() - begin);
  }
  return least;
}

void joint_fits(bench::Report& report) {
  constexpr int kVehicles = 10;
  const int repeats = report.accuracy_only() ? 1 : 40;
  test::SimulationOptions simulation;
  simulation.seed += report.seed();
  PinholeCamera camera;
  std::vector<VehicleDetection> detections;
  std::vector<SupportPlane> supports;
  for (int i = 0; i < kVehicles; ++i) {
    const test::SimulatedVehicle s =
        test::simulate_vehicle(simulation, static_cast<std::uint64_t>(i));
    camera = s.camera;
    detections.push_back(s.detection);
    supports.push_back(s.support);
  }
  std::vector<VehicleEstimate> starts = fit_vehicles(camera, detections, supports, {}, 1);
  const double start_ms =
      least_ms(repeats, [&] { starts = fit_vehicles(camera, detections, supports, {}, 1); }) /
      kVehicles;
  std::printf("start (every heading, 20 coefficients, covariance): %.2f ms a vehicle\n", start_ms);
  report
      .table("start", "Single fit of a vehicle: every heading, 20 coefficients, covariance", "",
             {bench::timing("time a vehicle")})
      .row({start_ms});
  bench::Table& table = report.table(
      "joint", "Joint problem (Ceres) of 10 vehicles with their planes, set-up included", "",
      {bench::label("derivatives"), bench::timing("time"), bench::value("vehicles"),
       bench::value("iterations"), bench::value("cost before"), bench::lower("cost after")});
  // From a rough place, as a start without refinement would be: a metre too far, turned by 3
  // degrees.
  std::vector<VehicleEstimate> rough = starts;
  for (VehicleEstimate& e : rough) {
    const SE3& pose = e.pose.camera_from_vehicle;
    e.pose.camera_from_vehicle = SE3(pose.rotation() * rotation_from_vector({0.0, 0.05, 0.0}),
                                     pose.translation() * (1.0 + 1.0 / pose.translation().norm()));
    e.shape.clear();
  }
  for (const bool with_covariance : {false, true}) {
    double times[2] = {0.0, 0.0};
    for (const bool analytic : {true, false}) {
      paper::JointFitOptions options;
      options.analytic = analytic;
      options.with_covariance = with_covariance;
      paper::JointFit fit;
      times[analytic ? 0 : 1] = least_ms(
          repeats, [&] { fit = paper::fit_joint(camera, detections, supports, rough, options); });
      const std::string kind = analytic ? "analytic" : "automatic";
      const char* const covariance = with_covariance ? ", with covariance" : "";
      std::printf("%s derivatives%s: %.2f ms, %d vehicles, %d iterations, cost %.2f to %.2f\n",
                  kind.c_str(), covariance, times[analytic ? 0 : 1], fit.solved, fit.iterations,
                  fit.initial_cost, fit.final_cost);
      table.row({kind + covariance, times[analytic ? 0 : 1], fit.solved, fit.iterations,
                 fit.initial_cost, fit.final_cost});
    }
    std::printf("ratio automatic / analytic: %.2f\n", times[1] / times[0]);
  }
}

}  // namespace
}  // namespace camber

int main(int argc, char** argv) {
  using namespace camber;
  return bench::run_program(
      {"bench_joint_fit", "Time of the joint problem over vehicles and planes", {}, {}}, argc, argv,
      joint_fits);
}
