// The options of `raylift localize`.

#pragma once

#include <filesystem>

#include "continuous_options.h"
#include "geometry_options.h"
#include "job_options.h"
#include "matching_options.h"
#include "mesh_only_options.h"
#include "options.h"
#include "scene_options.h"
#include <CLI/App.hpp>

#include "raylift/estimation/pose_estimator.h"

namespace raylift {

struct LocalizeFlags {
  ReferenceFlags references;
  std::filesystem::path images, queries, query_images, priors, rigs;
  ModelPosesFlags model_poses;
  GeometryFlags geometry;
  MatchingFlags matching;
  std::filesystem::path out, write_problems, write_model, report;
  int pictures = 0;
  double min_confidence = 0;
  bool no_doctor = false;
  bool leave_one_out = false;
  FilterFlags filter;
  EstimatorFlags estimator;
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
  void Check(const GeometryOptions& geometry_options,
             const EstimatorOptions& estimator_options) const;
};

// With examples.
void AddLocalizeOptions(CLI::App& command, LocalizeFlags& flags);

}  // namespace raylift
