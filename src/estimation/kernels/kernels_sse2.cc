#define RAYLIFT_KERNEL_BYTES 16
#include "estimation/kernels/kernels_impl.h"

namespace raylift::kernels {

const KernelTable& KernelTableSse2() {
  static constexpr KernelTable kTable = MakeKernelTable();
  return kTable;
}

}  // namespace raylift::kernels
