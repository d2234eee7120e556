// The window in the surface that shows the tool: the tool is drawn first and marks the stencil, the
// cloud tests the mark.

import { AlwaysStencilFunc, EqualStencilFunc, NotEqualStencilFunc, ReplaceStencilOp } from 'three';

const MARK = { stencilWrite: true, stencilRef: 1 };

export const OPENS_WINDOW = { ...MARK, stencilFunc: AlwaysStencilFunc, stencilZPass: ReplaceStencilOp };
export const WITHIN_WINDOW = { ...MARK, stencilFunc: EqualStencilFunc };
export const OUT_OF_WINDOW = { ...MARK, stencilFunc: NotEqualStencilFunc };
