#define RAYLIFT_KERNEL_BYTES 32
#include "estimation/kernels/kernels_impl.h"

namespace raylift::kernels {

const KernelTable& KernelTableAvx2() {
  static constexpr KernelTable kTable = MakeKernelTable();
  return kTable;
}

}  // namespace raylift::kernels
