// The scale's belief over evidence that was collected, with other parameters: what replay_scale.py
// runs. Reads FILE, a JSON array of {"evidence": [...], "truth": l}; then from standard input one
// object of parameters a line, {"noise": {...}, "sources": {NAME: {...}}, "other_layer": [p, ...]},
// and prints for each an array of [log density at the truth, mode, sigma, second mass], a case
// each.

#include <cmath>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <limits>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "camber/scale/scale_belief.h"

namespace {

using camber::ScaleEvidence;
using nlohmann::json;

double number(const json& value, double otherwise) {
  return value.is_number() ? value.get<double>() : otherwise;
}

struct Case {
  std::vector<ScaleEvidence> evidence;
  double truth = 0.0, alternative_spread = 0.0;
};

Case case_of(const json& of) {
  Case out;
  out.truth = of.at("truth").get<double>();
  for (const json& e : of.at("evidence")) {
    ScaleEvidence evidence;
    evidence.name = e.at("name").get<std::string>();
    evidence.cause = camber::evidence_cause_from_string(e.at("cause").get<std::string>());
    evidence.log_scale = number(e.at("log_scale"), 0.0);
    evidence.sigma = number(e.at("sigma"), std::numeric_limits<double>::quiet_NaN());
    evidence.freedom = number(e.at("freedom"), std::numeric_limits<double>::infinity());
    evidence.wrong_share = number(e.at("wrong_share"), 0.0);
    evidence.shares = e.at("shares").get<std::vector<std::string>>();
    if (evidence.name == "road_layer" && e.contains("measured")) {
      out.alternative_spread = number(e["measured"].value("alternative_spread", json()), 0.0);
    }
    out.evidence.push_back(std::move(evidence));
  }
  return out;
}

camber::ScaleBeliefNoise noise_of(const json& of) {
  camber::ScaleBeliefNoise out;
  out.step = of.value("step", out.step);
  out.wrong_focal_length = of.value("wrong_focal_length", out.wrong_focal_length);
  out.focal_length_spread = of.value("focal_length_spread", out.focal_length_spread);
  out.vehicles_by_focal_length = of.value("vehicles_by_focal_length", out.vehicles_by_focal_length);
  out.height = of.value("height", out.height);
  out.road_shape = of.value("road_shape", out.road_shape);
  out.size_population = of.value("size_population", out.size_population);
  return out;
}

json replayed(const Case& of, const json& parameters, std::size_t i) {
  std::vector<ScaleEvidence> evidence = of.evidence;
  const json sources = parameters.value("sources", json::object());
  for (ScaleEvidence& e : evidence) {
    if (!sources.contains(e.name)) continue;
    const json& source = sources[e.name];
    e.sigma *= source.value("spread", 1.0);
    e.freedom = source.value("freedom", e.freedom);
    e.wrong_share = source.value("wrong_share", e.wrong_share);
  }
  const json layers = parameters.value("other_layer", json::array());
  const double other = i < layers.size() ? layers[i].get<double>() : 0.0;
  const camber::ScaleBelief belief =
      camber::scale_belief(evidence, camber::scale_alternatives(other, of.alternative_spread),
                           noise_of(parameters.value("noise", json::object())));
  return {belief.log_density(of.truth), belief.mode, belief.sigma, belief.second_mass};
}

}  // namespace

int main(int argc, char** argv) {
  try {
    if (argc != 2) {
      std::fprintf(stderr, "usage: bench_replay_scale CASES.json < PARAMETERS\n");
      return 2;
    }
    std::ifstream file(argv[1]);
    if (!file) {
      std::fprintf(stderr, "%s: cannot be read\n", argv[1]);
      return 2;
    }
    std::vector<Case> cases;
    for (const json& of : json::parse(file)) cases.push_back(case_of(of));
    for (std::string line; std::getline(std::cin, line);) {
      const json parameters = json::parse(line);
      json out = json::array();
      for (std::size_t i = 0; i < cases.size(); ++i) {
        out.push_back(replayed(cases[i], parameters, i));
      }
      std::cout << out.dump() << std::endl;
    }
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s: %s\n", argv[1], error.what());
    return 2;
  }
  return 0;
}
