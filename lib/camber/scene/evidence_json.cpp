#include "camber/scene/evidence_json.h"

#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

#include "camber/scene/results.h"

namespace camber {
namespace {

nlohmann::json finite_or_null(double value) {
  return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json();
}

nlohmann::json one_json(const ScaleEvidence& evidence) {
  nlohmann::json out = {{"name", evidence.name},
                        {"source", evidence.source},
                        {"cause", to_string(evidence.cause)},
                        {"log_scale", finite_or_null(evidence.log_scale)},
                        {"sigma", finite_or_null(evidence.sigma)},
                        {"freedom", finite_or_null(evidence.freedom)},
                        {"wrong_share", finite_or_null(evidence.wrong_share)},
                        {"shares", evidence.shares}};
  if (evidence.measured.empty()) return out;
  nlohmann::json measured = nlohmann::json::object();
  for (const auto& [name, value] : evidence.measured) measured[name] = finite_or_null(value);
  out["measured"] = std::move(measured);
  return out;
}

}  // namespace

nlohmann::json to_json(const std::vector<ScaleEvidence>& evidence) {
  nlohmann::json out = nlohmann::json::array();
  for (const ScaleEvidence& e : evidence) out.push_back(one_json(e));
  return out;
}

void write_evidence(const nlohmann::json& evidence, const std::string& reason,
                    const std::filesystem::path& path) {
  write_json({{"format", "camber-evidence"},
              {"version", 1},
              {"answered", reason.empty()},
              {"reason", reason},
              {"evidence", evidence.is_array() ? evidence : nlohmann::json::array()}},
             path);
}

}  // namespace camber
