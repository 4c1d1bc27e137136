// The options of `raylift localize`.

#pragma once

#include <filesystem>

#include "apps/continuous_options.h"
#include "apps/job_options.h"
#include "apps/matching_options.h"
#include "apps/mesh_only_options.h"
#include "apps/options.h"
#include <CLI/App.hpp>

#include "raylift/estimation/options.h"

namespace raylift {

struct LocalizeFlags {
  ReferenceFlags references;
  std::filesystem::path images, queries, query_images, priors, rigs;
  PoseConvention model_poses = PoseConvention::kCamFromWorld;
  GeometryFlags geometry;
  MatchingFlags matching;
  std::filesystem::path out, write_problems, write_model, report;
  int pictures = 0;
  double min_confidence = 0;
  bool no_doctor = false;
  bool leave_one_out = false;
  FilterOptions filter;
  EstimatorOptions estimator;
  ContinuousFlags continuous;
  RunFlags run;
  JobFlags running;
  MeshOnlyFlags mesh_only;

  // The references are rendered from the mesh.
  bool RendersReferences() const { return references.model.empty(); }

  const std::filesystem::path& QueryImages() const {
    return query_images.empty() ? images : query_images;
  }

  // Whose poses queries have.
  RetrievalFlags::Queries QueriesAre() const {
    return leave_one_out ? RetrievalFlags::Queries::kReferences : RetrievalFlags::Queries::kOwn;
  }

  // OptionError for what the options alone can tell, before any work.
  void Check() const;
};

// With examples.
void AddLocalizeOptions(CLI::App& command, LocalizeFlags& flags);

}  // namespace raylift
