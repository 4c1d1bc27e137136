// What the results of a job depend on, as its manifest begins with it.

#pragma once

#include <cstddef>
#include <initializer_list>
#include <string>

#include <nlohmann/json.hpp>

namespace raylift {

// JSON: `options`, as EffectiveOptionsJson() gives them, without those of `needless` and those of
// all commands that change no result or say where something is; and `inputs`, fingerprints that
// stand for paths, so that the same run may go on on another machine.
std::string JobHeader(nlohmann::ordered_json options, size_t tasks,
                      std::initializer_list<const char*> needless,
                      const nlohmann::ordered_json& inputs);

// The effective options but for those that say how the work is shared and gone on with.
std::string OptionsOfResults(const std::string& options_json);

}  // namespace raylift
