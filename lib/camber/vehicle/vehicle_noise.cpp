#include "camber/vehicle/vehicle_noise.h"

#include <fmt/format.h>

#include <stdexcept>
#include <utility>

namespace camber {

namespace {

using Field = std::pair<const char*, double>;

void require(bool good, const Field& field, const char* bound) {
  if (good) return;
  throw std::invalid_argument(fmt::format("{}: {}, must be {}", field.first, field.second, bound));
}

template <std::size_t N>
void require_positive(const Field (&fields)[N]) {
  for (const Field& f : fields) require(f.second > 0.0, f, "> 0");
}

template <std::size_t N>
void require_share(const Field (&fields)[N]) {
  for (const Field& f : fields) require(f.second > 0.0 && f.second < 1.0, f, "in (0, 1)");
}

}  // namespace

void VehicleNoise::validate() const {
  require_share({{"keypoint.cell_share", keypoint.cell_share},
                 {"keypoint.far_share", keypoint.far_share},
                 {"keypoint.gross_share", keypoint.gross_share},
                 {"keypoint.seen_share_shown", keypoint.seen_share_shown},
                 {"keypoint.seen_share_hidden", keypoint.seen_share_hidden},
                 {"keypoint.stated_far_share", keypoint.stated_far_share},
                 {"keypoint.stated_gross_share", keypoint.stated_gross_share},
                 {"box.side_share", box.side_share},
                 {"form.min_size_share", form.min_size_share},
                 {"hypotheses.same_axis", hypotheses.same_axis},
                 {"registration.min_correlation", registration.min_correlation},
                 {"answer.agreeing_share", answer.agreeing_share},
                 {"answer.box_overlap", answer.box_overlap},
                 {"answer.least_size", answer.least_size},
                 {"association.overlap", association.overlap}});
  require_positive({{"keypoint.min_cell_px", keypoint.min_cell_px},
                    {"keypoint.seen", keypoint.seen},
                    {"keypoint.guessed", keypoint.guessed},
                    {"keypoint.guessed_far", keypoint.guessed_far},
                    {"keypoint.adapt_prior_count", keypoint.adapt_prior_count},
                    {"keypoint.adapt_min", keypoint.adapt_min},
                    {"keypoint.stated_scale", keypoint.stated_scale},
                    {"keypoint.stated_cut_scale", keypoint.stated_cut_scale},
                    {"keypoint.stated_far_scale", keypoint.stated_far_scale},
                    {"keypoint.min_shape_variance", keypoint.min_shape_variance},
                    {"box.pixel_sigma", box.pixel_sigma},
                    {"box.network_pixel_sigma", box.network_pixel_sigma},
                    {"box.gate", box.gate},
                    {"box.border_sigmas", box.border_sigmas},
                    {"contact.sigma_height", contact.sigma_height},
                    {"contact.sigma_tilt", contact.sigma_tilt},
                    {"contact.gate", contact.gate},
                    {"contact.contradiction", contact.contradiction},
                    {"motion.parked_shift", motion.parked_shift},
                    {"motion.parked_turn", motion.parked_turn},
                    {"motion.sideways", motion.sideways},
                    {"motion.vertical", motion.vertical},
                    {"motion.turning", motion.turning},
                    {"motion.tilting", motion.tilting},
                    {"motion.acceleration", motion.acceleration},
                    {"motion.speed", motion.speed},
                    {"motion.min_interval", motion.min_interval},
                    {"registration.place_px", registration.place_px},
                    {"registration.growth_px", registration.growth_px},
                    {"registration.body_depth", registration.body_depth},
                    {"registration.outlier_scale", registration.outlier_scale},
                    {"registration.gate", registration.gate},
                    {"hypotheses.start_scales[0]", hypotheses.start_scales[0]},
                    {"hypotheses.start_scales[1]", hypotheses.start_scales[1]},
                    {"hypotheses.start_scales[2]", hypotheses.start_scales[2]},
                    {"hypotheses.start_height_sigma", hypotheses.start_height_sigma},
                    {"answer.source_contradicts", answer.source_contradicts},
                    {"answer.relative_sigma", answer.relative_sigma},
                    {"message.gate", message.gate},
                    {"association.speed", association.speed}});
  for (const Field& f :
       {Field{"keypoint.confidence_log_odds", keypoint.confidence_log_odds},
        Field{"keypoint.confidence_evidence", keypoint.confidence_evidence},
        Field{"box.body_share", box.body_share}, Field{"box.border_px", box.border_px},
        Field{"form.centre_share", form.centre_share},
        Field{"registration.growth_share", registration.growth_share},
        Field{"registration.correlated_pixels", registration.correlated_pixels},
        Field{"hypotheses.pruned", hypotheses.pruned},
        Field{"hypotheses.same_heading", hypotheses.same_heading},
        Field{"hypotheses.swap_evidence", hypotheses.swap_evidence},
        Field{"hypotheses.rival_heading", hypotheses.rival_heading},
        Field{"hypotheses.heading_evidence", hypotheses.heading_evidence},
        Field{"hypotheses.parked_pruned", hypotheses.parked_pruned},
        Field{"hypotheses.start_min_seen", hypotheses.start_min_seen},
        Field{"answer.agreeing_keypoints", answer.agreeing_keypoints},
        Field{"answer.source_agrees", answer.source_agrees}}) {
    require(f.second >= 0.0, f, ">= 0");
  }
  require(answer.source_contradicts > answer.source_agrees,
          {"answer.source_contradicts", answer.source_contradicts}, "> answer.source_agrees");
  require(keypoint.adapt_max >= keypoint.adapt_min, {"keypoint.adapt_max", keypoint.adapt_max},
          ">= keypoint.adapt_min");
}

void SupportOptions::validate() const {
  require_positive({{"given_sigma_height", given_sigma_height},
                    {"given_sigma_tilt", given_sigma_tilt},
                    {"ego_sigma_height", ego_sigma_height},
                    {"ego_sigma_tilt", ego_sigma_tilt},
                    {"level_sigma_height", level_sigma_height},
                    {"level_sigma_tilt", level_sigma_tilt}});
  require(road_unmodelled_height >= 0.0, {"road_unmodelled_height", road_unmodelled_height},
          ">= 0");
}

}  // namespace camber
