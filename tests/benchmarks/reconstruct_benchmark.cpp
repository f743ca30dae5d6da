// Time of the main job on the embedded scene, pictures left out, stage by stage.
//   bench_reconstruct --benchmark_repetitions=5 --benchmark_report_aggregates_only=true

#include <benchmark/benchmark.h>

#include "camber/pipeline/reconstruct.h"

namespace {

/// One iteration is one whole run; counters are the mean milliseconds of each stage.
void reconstruct_steep_hill(benchmark::State& state) {
  const camber::Scene scene = camber::read_scene(CAMBER_SOURCE_DIR "/samples/steep_hill");
  const std::vector<int> frames = camber::select_frames(scene, "");
  camber::ReconstructOptions options;
  options.num_threads = static_cast<int>(state.range(0));
  camber::Timings timings;
  for (auto _ : state) {
    const camber::Reconstruction result = camber::reconstruct(scene, frames, options);
    for (const auto& [stage, milliseconds] : result.run.timings.stages()) {
      timings.add(stage, milliseconds);
    }
  }
  double sum = 0.0;
  for (const auto& [stage, milliseconds] : timings.stages()) {
    state.counters[stage + "_ms"] =
        benchmark::Counter(milliseconds, benchmark::Counter::kAvgIterations);
    if (stage != "load") sum += milliseconds;
  }
  state.counters["all_but_load_ms"] = benchmark::Counter(sum, benchmark::Counter::kAvgIterations);
}
BENCHMARK(reconstruct_steep_hill)
    ->ArgName("threads")
    ->Arg(1)
    ->Arg(2)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

}  // namespace
