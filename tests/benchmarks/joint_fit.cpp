// Time of the paper's joint problem over ten vehicles and their planes, one thread, with its
// set-up: analytic derivatives against their automatic twin, Cholesky against conjugate gradients;
// and of the single fits and starts. Processor time, the least of several repeats. The seed is that
// of the simulated vehicles.

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
      "joint",
      "The paper's joint problem (Ceres) of 10 vehicles with their planes, set-up included", "",
      {bench::label("derivatives and solver"), bench::timing("time"), bench::value("vehicles"),
       bench::value("iterations"), bench::value("cost before"), bench::lower("cost after")});
  const std::vector<paper::VehicleStart> on_planes =
      paper::starts_on_planes(camera, detections, supports, {});
  const double on_planes_ms =
      least_ms(repeats, [&] { paper::starts_on_planes(camera, detections, supports, {}); }) /
      kVehicles;
  std::printf("the paper's start on the plane: %.2f ms a vehicle\n", on_planes_ms);
  struct Variant {
    const char* name;
    bool analytic, iterative, covariance;
  };
  for (const Variant& v : {Variant{"analytic, Cholesky", true, false, false},
                           Variant{"automatic, Cholesky", false, false, false},
                           Variant{"analytic, CGNR with Jacobi", true, true, false},
                           Variant{"analytic, Cholesky, with covariance", true, false, true}}) {
    paper::JointFitOptions options;
    options.analytic = v.analytic;
    options.with_covariance = v.covariance;
    if (v.iterative) options.solver = paper::LinearSolver::kConjugateGradients;
    paper::JointFit fit;
    const double time =
        least_ms(repeats, [&] { fit = paper::fit_joint(camera, supports, on_planes, options); });
    std::printf("%s: %.2f ms, %d vehicles, %d iterations, cost %.2f to %.2f\n", v.name, time,
                fit.solved, fit.iterations, fit.initial_cost, fit.final_cost);
    table.row({v.name, time, fit.solved, fit.iterations, fit.initial_cost, fit.final_cost});
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
