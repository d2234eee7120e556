// The window in the surface, through which the tool is seen: the tool is drawn first and leaves a
// mark in the stencil, the cloud requires it.

import { AlwaysStencilFunc, EqualStencilFunc, NotEqualStencilFunc, ReplaceStencilOp } from 'three';

const MARK = { stencilWrite: true, stencilRef: 1 };

export const OPENS_WINDOW = { ...MARK, stencilFunc: AlwaysStencilFunc, stencilZPass: ReplaceStencilOp };
export const WITHIN_WINDOW = { ...MARK, stencilFunc: EqualStencilFunc };
export const OUT_OF_WINDOW = { ...MARK, stencilFunc: NotEqualStencilFunc };
