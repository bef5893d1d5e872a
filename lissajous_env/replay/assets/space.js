export class Space {}
